# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The trials of landmarks run, and every part that is switched off is there."""

import math

import numpy as np
import pytest

from evaluation.bench import landmark_parts, landmark_trials
from evaluation.bench.landmark_trials import drone_trial, room_trial, tilt_trial


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1)


@pytest.mark.parametrize('part', landmark_parts.PARTS)
def test_what_a_part_is_switched_off_by_exists(part: str) -> None:
    for target, attribute, _ in landmark_parts.PARTS[part]:
        assert hasattr(target, attribute), f'{part}: there is no {attribute}'


def test_the_tilt_of_an_object_is_seen_best_against_the_line_of_sight(
    rng: np.random.Generator,
) -> None:
    found = tilt_trial(math.radians(15), rng)
    assert found is not None
    sight_deg, fixed_deg = found
    assert sight_deg < 2
    assert fixed_deg < 20


def test_a_drone_and_a_robot_are_located(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(landmark_trials, 'FLIGHT_S', 10.0)
    errors_m = [one.position_m for one in drone_trial(rng)[3:]]
    assert np.median(errors_m) < 0.05
    off_m = room_trial(rng)
    assert off_m is not None
    assert off_m < 0.1
