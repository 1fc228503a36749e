# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import runpy
from pathlib import Path

IMAGES = Path(__file__).parents[2] / 'docs' / 'images'


def test_the_layouts_are_drawn_from_their_files() -> None:
    """`embedded/run python docs/images/viewers.py` draws them again."""
    module = runpy.run_path(str(IMAGES / 'viewers.py'))
    assert module['drawing']() == (IMAGES / 'viewers.svg').read_text(encoding='utf-8')


def test_the_overview_is_that_of_its_script() -> None:
    """`embedded/run python docs/images/overview.py` draws it again."""
    module = runpy.run_path(str(IMAGES / 'overview.py'))
    assert module['drawing']() == (IMAGES / 'overview.svg').read_text(encoding='utf-8')
