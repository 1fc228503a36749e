# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One packet: what is reported of it, against what was sent."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluation.experiments import chain
from retrolidar_ros.marker.code import packet


@pytest.fixture(scope='module')
def figures() -> dict[str, Any]:
    made = chain.run(np.random.default_rng(4), quick=True)
    read: dict[str, Any] = json.loads(json.dumps(made, allow_nan=False))
    return read


def test_the_packet_is_read_and_nothing_else(figures: dict[str, Any]) -> None:
    reading, marker = figures['reading'], figures['marker']
    assert reading['ids'] == [marker['id']]
    assert reading['bits'] == packet(marker['id']).tolist()
    assert abs(reading['bit_error_percent']) < 0.5
    assert abs(reading['range_error_mm']) < 20


def test_what_is_read_meets_the_demands(figures: dict[str, Any]) -> None:
    demands = figures['demands']
    (read,) = (row for row in figures['candidates'] if row['reason'] == 'read')
    assert read['id'] == figures['marker']['id']
    assert read['evidence'] >= demands['evidence']
    assert read['word'] <= demands['word']
    assert read['margin'] >= demands['margin']


def test_the_fitted_light_is_that_of_the_samples(figures: dict[str, Any]) -> None:
    samples = figures['samples']
    assert np.corrcoef(samples['signal'], samples['light'])[0, 1] > 0.9


def test_it_is_told_and_drawn(figures: dict[str, Any], tmp_path: Path) -> None:
    assert f'ID {figures["marker"]["id"]} in zones' in chain.summarise(figures)
    assert chain.compare(figures)[0].default == str(figures['marker']['id'])
    assert 'three questions' in chain.comment(figures)
    chain.draw(figures, tmp_path / 'chain.png')
    assert (tmp_path / 'chain.png').read_bytes().startswith(b'\x89PNG')
