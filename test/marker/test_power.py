# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What wakes a marker, and how long its battery lasts."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.experiments.marker import WITH_LIDAR_V
from retrolidar_ros.marker.wakeup import (
    GUARD_V,
    LARGEST_ANGLE_RAD,
    NOISE_V,
    THRESHOLD_V,
    WAKING_S,
    light_v,
    voltage_v,
    wakeup_range_m,
)

RANGES_M = st.floats(0.1, 20)
ANGLES_RAD = st.floats(0, LARGEST_ANGLE_RAD)
NOISES_V = st.sampled_from(sorted(NOISE_V.values()))


def test_published_values() -> None:
    assert wakeup_range_m() == pytest.approx(2.25)
    at_1_m = float(voltage_v(np.array(1.0)))
    assert at_1_m == pytest.approx(WITH_LIDAR_V, rel=0.05)
    assert at_1_m > WITH_LIDAR_V  # what the model has too much, not too little
    # Had voltages been added, the guard would be all the light there is at 2.25 m.
    assert NOISE_V['indoors'] + GUARD_V * 2.25**2 < 0.7 * WITH_LIDAR_V
    assert pytest.approx(0.1004) == WAKING_S


def test_outdoors_the_indoor_threshold_keeps_the_marker_awake() -> None:
    assert wakeup_range_m(THRESHOLD_V, NOISE_V['outdoors']) == math.inf
    outdoors = wakeup_range_m(NOISE_V['outdoors'] + GUARD_V, NOISE_V['outdoors'])
    assert outdoors == pytest.approx(1.85, abs=0.01)
    # An infrared camera does not wake it; and where there is less noise, more light is needed.
    assert 2.25 < wakeup_range_m(THRESHOLD_V, NOISE_V['LED']) < math.inf
    assert wakeup_range_m(THRESHOLD_V, NOISE_V['dark']) < 2.25


def test_beyond_the_largest_angle_there_is_noise_only() -> None:
    for angle in (math.radians(55.5), -math.radians(56), math.pi / 2):
        assert float(voltage_v(np.array(0.3), angle)) == NOISE_V['indoors']
        assert wakeup_range_m(angle_rad=angle) == 0
    assert float(light_v(np.array(1.0), math.radians(54.9))) > 0


@given(RANGES_M, RANGES_M, ANGLES_RAD)
def test_light_falls_with_the_square_of_the_distance(first: float, second: float, a: float) -> None:
    ratio = float(light_v(np.array(first), a) / light_v(np.array(second), a))
    assert ratio == pytest.approx((second / first) ** 2)


@given(ANGLES_RAD, NOISES_V, st.floats(1e-4, 0.1))
def test_range_and_voltage_agree(angle: float, noise_v: float, guard_v: float) -> None:
    range_m = wakeup_range_m(noise_v + guard_v, noise_v, angle)
    assert float(voltage_v(np.array(range_m), angle, noise_v)) == pytest.approx(noise_v + guard_v)
    assert wakeup_range_m(noise_v + 2 * guard_v, noise_v, angle) < range_m
