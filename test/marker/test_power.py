# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What wakes a marker, and how long its battery lasts."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.experiments import marker
from evaluation.experiments.marker import WITH_LIDAR_V
from retrolidar_ros.marker.battery import CELL_MAH, PROTOTYPE, Currents, active_share, drawn, life_h
from retrolidar_ros.marker.wakeup import (
    GUARD_V,
    LARGEST_ANGLE_RAD,
    LOOK_S,
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


def test_the_guard_is_that_of_sampled_noise() -> None:
    bandwidth_hz, rng = 20e3, np.random.default_rng(2)
    samples = round(2 * bandwidth_hz * LOOK_S)
    looks = 16e-3 * np.sqrt((rng.standard_normal((200_000, samples)) ** 2).mean(axis=1))
    for chance in (0.1, 0.01, 0.001):
        found = float(np.quantile(looks, 1 - chance)) - 16e-3
        assert marker.guard_v(bandwidth_hz, chance, 16e-3) == pytest.approx(found, rel=0.03)
        threshold_v = 16e-3 + marker.guard_v(bandwidth_hz, chance, 16e-3)
        woken = marker.false_per_hour(bandwidth_hz, threshold_v, 16e-3)
        assert woken == pytest.approx(36_000 * chance)


MONTH_H, YEAR_H = 730.5, 8766.0


def life_at(queries: float, currents: Currents = PROTOTYPE) -> float:
    return life_h(CELL_MAH, drawn(active_share(queries), currents).total)


def test_two_months_hold() -> None:
    assert 2 < life_at(1) / MONTH_H < 3
    assert 2 < life_h(CELL_MAH, drawn(0.001).total) / MONTH_H < 3


def test_modes_are_weighed_by_their_time() -> None:
    # By hand: 1 % of 3.98 mA, 99 % of 1 µA, and 1.302 s of each hour with 12.7 mA.
    means = drawn(active_share(1))
    assert means.detection == pytest.approx(0.0398, rel=1e-3)
    assert means.sleep == pytest.approx(0.00099, rel=1e-3)
    assert means.active == pytest.approx(12.7 * 1.302 / 3600)
    assert drawn(1.0) == Currents(0, 0, 12.7)


def test_two_years_need_a_lower_active_current() -> None:
    rare = replace(PROTOTYPE, detection=0.1)
    assert life_at(1, rare) < 2 * YEAR_H
    assert life_at(1, replace(rare, active=0.1)) > 2 * YEAR_H
    assert life_h(CELL_MAH, 0.1) < life_at(1)  # a mean of 100 µA is worse than the prototype
