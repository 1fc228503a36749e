# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluation.bench.detectors import new_detector
from evaluation.bench.false_ids import false_ids, wall_blocks
from evaluation.experiments.registry import EXPERIMENTS, run_experiments
from evaluation.experiments.time_to_id import (
    TIMEOUT_S,
    VIEW_S,
    appearing,
    first_ids,
    time_by_which,
)
from evaluation.report.panels import PANELS
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL


def test_a_bare_wall_is_white_noise_about_its_signal() -> None:
    blocks = list(wall_blocks(120, np.random.default_rng(0)))
    signal = np.concatenate([block.signal for block in blocks])
    assert len(signal) == round(120 / SENSOR.period_s)
    assert signal.mean() == pytest.approx(WALL_SIGNAL, rel=0.05)
    centred = signal - signal.mean(axis=0)
    assert abs((centred[1:] * centred[:-1]).mean() / centred.var()) < 0.02


def test_every_reading_without_marker_is_a_false_id() -> None:
    # So lax that the paper's method reads in noise all the time.
    detector = new_detector('paper', SENSOR.grid, strictness=0.01)
    hours = 30 / 3600
    measured = false_ids(detector, wall_blocks(30, np.random.default_rng(0)), hours)
    assert measured['events'] > 10
    assert measured['per_hour'] == pytest.approx(measured['events'] / hours)


def test_time_by_which_a_share_is_identified() -> None:
    times_s = np.array([4.0, 1.0, math.inf, 3.0, 2.0])
    assert time_by_which(0.5, times_s) == 3.0
    assert time_by_which(0.8, times_s) == 4.0
    assert time_by_which(0.9, times_s) is None


def test_a_marker_is_identified_no_sooner_than_a_word_after_it_came_into_view() -> None:
    trial = appearing(24, np.random.default_rng(3))
    duration_s = trial.recording.stamp_ns[-1] * 1e-9
    assert duration_s == pytest.approx(VIEW_S + TIMEOUT_S, abs=0.03)
    times_s, wrong = first_ids(trial, new_detector('paper', SENSOR.grid))
    assert np.isfinite(times_s).mean() > 0.8
    assert times_s.min() > 24 * 0.042
    assert times_s[np.isfinite(times_s)].max() <= TIMEOUT_S
    assert wrong >= 0


# So small that all run in seconds.
TINY: dict[str, dict[str, Any]] = {
    'stability': {'PANELS': PANELS[::3]},
    'speed-accuracy': {'_QUICK_SNRS_DB': (20.0,), '_QUICK_FRAMES': 50, '_QUICK_HOURS': 0.001},
    'roc': {'_SNRS_DB': (10.0,), '_QUICK_HOURS': 0.001},
    'time-to-id': {},
}


@pytest.mark.parametrize('name', TINY)
def test_experiments_write_figures_and_a_chart(
    name: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # The method that takes the least time; that all methods read is tested with the links.
    monkeypatch.setattr(EXPERIMENTS[name], 'METHODS', ('paper',))
    for attribute, value in TINY[name].items():
        monkeypatch.setattr(EXPERIMENTS[name], attribute, value)
    run_experiments([name], tmp_path, quick=True)
    figures = json.loads(
        (tmp_path / f'{name}.json').read_text(), parse_constant=lambda word: pytest.fail(word)
    )
    assert figures['run']['quick'] is True
    assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
    summary = capsys.readouterr().out
    assert summary.startswith(f'{name}\n')
    assert 'paper' in summary
