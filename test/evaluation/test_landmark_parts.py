# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The trials of landmarks run, and every part that is switched off is there."""

import math

import numpy as np
import pytest

from evaluation.bench import landmark_parts, landmark_trials
from evaluation.bench.landmark_trials import drone_trial, room_trial, tilt_trial


@pytest.mark.parametrize('part', landmark_parts.PARTS)
def test_what_a_part_is_switched_off_by_exists(part: str) -> None:
    for target, attribute, _ in landmark_parts.PARTS[part]:
        assert hasattr(target, attribute), f'{part}: there is no {attribute}'


def test_an_object_a_drone_and_a_robot_are_located(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landmark_trials, 'FLIGHT_S', 10.0)
    rng = np.random.default_rng(1)
    tilt_deg, off_m = tilt_trial(math.radians(15), rng), room_trial(rng)
    assert tilt_deg is not None
    assert tilt_deg[0] < 2
    assert off_m is not None
    assert off_m < 0.1
    assert np.median([one.position_m for one in drone_trial(rng)[3:]]) < 0.05
