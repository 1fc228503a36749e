# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import re

import pytest
from harness_firmware import FIRMWARE, ROOT


@pytest.mark.parametrize('sketch', ['reader', 'marker'])
def test_a_drawing_names_the_pins_of_its_sketch(sketch: str) -> None:
    source = (FIRMWARE / sketch / f'{sketch}.ino').read_text(encoding='utf-8')
    drawing = (ROOT / 'docs' / 'images' / f'hardware_{sketch}.svg').read_text(encoding='utf-8')
    pins = re.findall(r'_PIN = (\w+)', source)
    assert pins
    for pin in pins:
        assert re.search(rf'>{pin}\b', drawing), pin
