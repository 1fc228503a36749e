# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import re
import runpy
from pathlib import Path
from xml.etree import ElementTree

import pytest

IMAGES = Path(__file__).parents[2] / 'docs' / 'images'
# Of a letter, in font sizes: wider than the average of any usual font, bold included.
_WIDEST = 0.7


def texts_of(group: ElementTree.Element, x: float = 0.0) -> list[tuple[str, float]]:
    """Return all texts with the x at which they begin."""
    move = re.match(r'translate\((\S+)', group.get('transform', ''))
    x += float(move[1]) if move else 0.0
    found = []
    for one in group:
        if one.tag.endswith('text'):
            found.append((one.text or '', x + float(one.get('x', '0'))))
        found += texts_of(one, x)
    return found


@pytest.mark.parametrize('name', ['landmarks'])
def test_text_has_room_in_any_font(name: str) -> None:
    drawing = ElementTree.fromstring((IMAGES / f'{name}.svg').read_text(encoding='utf-8'))
    width = float(drawing.get('viewBox', '').split()[2])
    size = float(drawing.get('font-size', ''))
    texts = texts_of(drawing)
    assert texts
    for text, x in texts:
        assert x + _WIDEST * size * len(text) < width, text


def test_the_layouts_are_drawn_from_their_files() -> None:
    """`embedded/run python docs/images/viewers.py` draws them again."""
    module = runpy.run_path(str(IMAGES / 'viewers.py'))
    assert module['drawing']() == (IMAGES / 'viewers.svg').read_text(encoding='utf-8')
    drawing = ElementTree.fromstring(module['drawing']())
    texts = {text.strip() for text, _ in texts_of(drawing)}
    assert {'Displays', 'Zones and markers', '/retrolidar/points', 'mug'} <= texts


def test_the_overview_is_that_of_its_script() -> None:
    """`embedded/run python docs/images/overview.py` draws it again."""
    module = runpy.run_path(str(IMAGES / 'overview.py'))
    assert module['drawing']() == (IMAGES / 'overview.svg').read_text(encoding='utf-8')
