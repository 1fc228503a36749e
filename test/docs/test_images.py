# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drawings are those of their scripts, with the pins of the sketches and the parts of the bill."""

import re
import runpy
from pathlib import Path

import pytest
from harness_firmware import FIRMWARE, ROOT

IMAGES = Path(__file__).parents[2] / 'docs' / 'images'


def test_the_layouts_are_drawn_from_their_files() -> None:
    """`embedded/run python docs/images/viewers.py` draws them again."""
    module = runpy.run_path(str(IMAGES / 'viewers.py'))
    assert module['drawing']() == (IMAGES / 'viewers.svg').read_text(encoding='utf-8')


def test_the_overview_is_that_of_its_script() -> None:
    """`embedded/run python docs/images/overview.py` draws it again."""
    module = runpy.run_path(str(IMAGES / 'overview.py'))
    assert module['drawing']() == (IMAGES / 'overview.svg').read_text(encoding='utf-8')


@pytest.mark.parametrize('sketch', ['reader', 'marker'])
def test_a_drawing_names_the_pins_of_its_sketch(sketch: str) -> None:
    source = (FIRMWARE / sketch / f'{sketch}.ino').read_text(encoding='utf-8')
    drawing = (ROOT / 'docs' / 'images' / f'hardware_{sketch}.svg').read_text(encoding='utf-8')
    pins = re.findall(r'_PIN = (\w+)', source)
    assert pins
    for pin in pins:
        assert re.search(rf'>{pin}\b', drawing), pin


def test_the_schematic_has_the_pins_of_the_sketch_and_the_parts_of_the_bill() -> None:
    source = (FIRMWARE / 'marker' / 'marker.ino').read_text(encoding='utf-8')
    page = (ROOT / 'docs' / 'hardware.md').read_text(encoding='utf-8')
    drawing = (ROOT / 'docs' / 'images' / 'hardware_schematic.svg').read_text(encoding='utf-8')
    drawn = set(re.findall(r'class="n">([A-Z]+\d+)[AB]?<', drawing))
    bill = page.partition('images/hardware_schematic.svg')[2].partition('\n\nA marker')[0]
    assert drawn == set(re.findall(r'\b((?:R|C|U|PD|CR|P)\d+)\b', bill))
    assert set(re.findall(r'class="pin">(\w+)<', drawing)) == {
        *re.findall(r'_PIN = (\w+)', source),
        '5V',
    }
    for part in ('74AHCT125', 'BPW34 FA', 'OPA320', 'SMS7630', 'TLV7031'):
        assert part in drawing
        assert part in bill
