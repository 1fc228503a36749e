# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Every experiment runs, and gives figures, words and a chart: their shape, not their digits."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from evaluation.__main__ import main
from evaluation.bench.stresses import LABORATORY, PANELS
from evaluation.experiments import false_ids, peers
from evaluation.experiments.paper_sweeps import SWEEPS
from evaluation.experiments.registry import EXPERIMENTS, run_experiment

# So small that all run in seconds, by the module that has a size.
TINY: dict[str, dict[str, Any]] = {
    'experiments.bound': {'RANGES_M': (2.5, 3.8), '_GENIE_RECORDINGS': 1},
    'experiments.coffee': {'_QUICK_TRIALS': 1},
    'experiments.drone': {'QUICK_DURATION_S': 11.0},
    'experiments.laboratory': {
        'LABORATORY': [replace(one, values=one.values[:4]) for one in LABORATORY]
    },
    'experiments.landmarks': {'_SIDES_M': (0.2, 0.4)},
    'experiments.moving': {'DURATION_S': 4.0},
    'experiments.peers': {
        '_QUICK_PICTURES': 2,
        '_SWEEPS': {
            name: (axis, (places[0], *places[:1:-6]), what, make)
            for name, (axis, places, what, make) in peers._SWEEPS.items()
        },
    },
    'experiments.paper_sweeps': {'TAG_RANGES_M': (1.0, 4.2)},
    'experiments.place': {'_QUICK_MARKERS': 12},
    'experiments.roc': {'_QUICK_SHARE': 0.0005},
    'experiments.rooms': {'QUICK_ROOMS': 2},
    'experiments.several': {'_QUICK_TRIALS': 1, '_RECORDINGS': 1},
    'experiments.speed_accuracy': {
        '_LONE_M': (1.0, 3.2),
        '_SEVERAL_M': (1.0, 4.0),
        '_FRAMES': 20,
        '_WARM_UP_FRAMES': 100,
    },
    'experiments.stability': {'PANELS': PANELS[:1], 'CONDITIONS': [(2.0, False)]},
    'experiments.track_ends': {'_GONE_BITS': (8.5,)},
    'experiments.tracks': {'DURATION_S': 5.0, '_PICTURES': 2, '_SPEEDS_M_S': (0.0, 0.3)},
    'experiments.time_to_id': {'_RANGES_M': (1.0, 3.6)},
    'peers.camera': {'_LEAVES': 200},
    'peers.visual_markers': {'QUICK_PICTURES': 2},
}


@pytest.mark.parametrize('name', [name for name in EXPERIMENTS if name != false_ids.NAME])
def test_an_experiment_runs(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for module, sizes in TINY.items():
        for attribute, value in sizes.items():
            monkeypatch.setattr(f'evaluation.{module}.{attribute}', value)
    for sweep in SWEEPS.values():
        ends = [
            replace(curve, places=(curve.places[0], curve.places[-1]), recordings=1)
            for curve in sweep.curves
        ]
        monkeypatch.setattr(sweep, 'curves', ends)
    words = run_experiment(name, tmp_path, quick=True, seed=1)
    assert 'QUICK RUN: ROUGH' in words
    figures = json.loads(
        (tmp_path / f'{name}.json').read_text(), parse_constant=lambda word: pytest.fail(word)
    )
    assert figures['run']['quick'] is True
    assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
    _, *lines, end = words.split('\n')
    assert not end
    rows = [line.count(' | ') for line in lines if line.startswith('| ')]
    claims = [line.count(' | ') for line in lines if not line.startswith('|')]
    assert len({*rows}) <= 1
    assert {*claims} <= {2}


def test_hours_without_a_marker_add_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(false_ids, 'MEMBERS', ['white', 'hands'])
    path, turn_h = tmp_path / 'false-ids.json', 0.002

    def run(hours: float, seed: int = 1) -> int:
        return len(list(false_ids.extend(path, hours, seed=seed, turn_h=turn_h, processes=1)))

    def hours() -> float:
        return false_ids.total(json.loads(path.read_text()))['hours']

    assert run(4 * turn_h) == 1  # a round: hands have three turns
    assert run(4 * turn_h) == 0
    assert run(8 * turn_h) == 1
    assert run(12 * turn_h, seed=2) == 1
    assert hours() == pytest.approx(12 * turn_h)
    monkeypatch.setattr(false_ids, 'revision', lambda: 'another core')
    assert run(turn_h) == 1
    assert hours() == pytest.approx(4 * turn_h)
    assert main(['false-ids', '-o', str(tmp_path)]) == 2
