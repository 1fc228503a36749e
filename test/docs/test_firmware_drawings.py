# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The drawings of docs/hardware.md are made from the sketches, and are those in the repository."""

import runpy
from pathlib import Path

import matplotlib
import pytest
from harness_firmware import FIRMWARE, ROOT
from matplotlib.image import imread


@pytest.fixture(scope='module')
def directory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp('drawings')
    runpy.run_path(str(FIRMWARE / 'drawings.py'))['main'](directory)
    return directory


@pytest.mark.parametrize('name', ['reader', 'marker', 'stack', 'timing'])
def test_a_drawing_is_the_one_that_the_code_makes(directory: Path, name: str) -> None:
    file = f'hardware_{name}.png'
    drawn, kept = imread(directory / file), imread(ROOT / 'docs' / 'images' / file)
    assert drawn.shape == kept.shape
    assert drawn.std() > 0.05
    if not matplotlib.__version__.startswith('3.10.'):
        pytest.skip('another matplotlib sets type a pixel elsewhere')
    assert abs(drawn - kept).max() < 0.01


def test_the_drawings_show_the_pins_of_the_sketches() -> None:
    drawings = runpy.run_path(str(FIRMWARE / 'drawings.py'))
    assert drawings['pins']('marker') == {
        'FIRST': 'D9',
        'SECOND': 'D10',
        'FRONTEND': 'D3',
        'LIGHT': 'D2',
    }
    assert drawings['constant']('marker', 'BIT_US') == 42_000
    with pytest.raises(ValueError, match=r'marker\.ino sets no COLOUR'):
        drawings['constant']('marker', 'COLOUR')
