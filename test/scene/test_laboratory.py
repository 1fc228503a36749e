# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Hands, moving sensors, faint crystals, bright light, glass and neighbours."""

from typing import Any

import numpy as np
import pytest

from retrolidar_ros.scene import Simulation, parse_scene
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.settings.section import Triple

MARKER = {'id': 2816, 'position': ['0.107 m', '0.107 m', '1 m']}  # in the middle of zone 10
WALL = {'distance': '1.05 m', 'signal': '40 kcps/SPAD'}


def seen(seconds: float = 8.0, **scene: Any) -> Recording:
    return Simulation(parse_scene(scene)).run(seconds)


def way(end_s: float, begin: Triple, end: Triple, yaw_deg: tuple[int, int] = (0, 0)) -> Any:
    """Return a path of two waypoints [m]."""
    return [
        {'time': f'{time_s} s', 'position': [f'{one} m' for one in place], 'yaw': f'{yaw} deg'}
        for time_s, place, yaw in zip((0, end_s), (begin, end), yaw_deg, strict=True)
    ]


def test_contrast_is_what_a_dark_crystal_blocks() -> None:
    half = {**MARKER, 'contrast': '80 %', 'signal_at_1_m': '200 kcps/SPAD'}
    signal = seen(markers=[half]).signal[:, 10]
    assert signal.min() / signal.max() == pytest.approx(0.2, abs=0.001)
    assert signal.max() == pytest.approx(200 * (1 + 2 * 0.107**2) ** -1.9, rel=0.01)


def test_an_offset_lengthens_all_ranges() -> None:
    distance = seen(
        1, sensor={'ranging': {'shot': '0 m', 'floor': '0 m', 'offset': '20 mm'}}, surfaces=[WALL]
    ).distance
    np.testing.assert_allclose(
        distance[0, [0, 5]], 1.05 + 0.020 * np.array([0.9072, 0.9851]), atol=2e-4
    )


def test_a_dead_time_bends_bright_signals_and_leaves_faint_ones() -> None:
    bright = {'distance': '0.3 m', 'signal': '1000 kcps/SPAD', 'zones': [0]}
    signal = seen(1, sensor={'saturation': '3000 kcps/SPAD'}, surfaces=[WALL, bright]).signal[0]
    assert signal[0] == pytest.approx(1000 / (1 + 1000 / 3000))
    assert signal[5] == pytest.approx(40 / (1 + 40 / 3000))


def test_crosstalk_is_a_target_where_nothing_is_brighter() -> None:
    dim = {'distance': '2 m', 'signal': '4 kcps/SPAD', 'zones': [3]}
    near = {'distance': '0.3 m', 'signal': '50 kcps/SPAD', 'zones': [4]}
    recording = seen(1, sensor={'crosstalk': '6 kcps/SPAD'}, surfaces=[dim, near])
    assert recording.distance[0, 3] == pytest.approx(0.01)
    assert recording.signal[0, 4] == pytest.approx(56)  # merged, and nearer than it is
    assert recording.distance[0, 4] == pytest.approx((50 * 0.3 + 6 * 0.01) / 56)


def test_a_second_sensor_raises_the_ambient_light_while_it_sends() -> None:
    second = {'ambient': '20 kcps/SPAD', 'period': '33 ms', 'lasting': '11 ms'}
    noise = {'floor': '1 (kcps/SPAD)^2', 'slope': '0 kcps/SPAD', 'ambient': '1 kcps/SPAD'}
    recording = seen(
        60, sensor={'second_sensor': second, 'noise': noise}, surfaces=[WALL], ambient='3 kcps/SPAD'
    )
    ambient = recording.ambient[:, 0]
    assert ambient.mean() == pytest.approx(3 + 20 / 3, rel=0.01)
    assert ambient.min() == pytest.approx(3.0)
    lit = ambient > np.median(ambient)
    assert recording.signal[lit].var() > 1.5 * recording.signal[~lit].var()


def test_a_hand_on_a_path_hides_what_is_behind_it() -> None:
    path = way(4, (-2, 0, 0.5), (2, 0, 0.5))
    hand = {'width': '60 cm', 'signal': '60 kcps/SPAD', 'path': path}
    recording = seen(4, markers=[MARKER], surfaces=[WALL], moving_surfaces=[hand])
    middle = len(recording) // 2
    assert recording.distance[middle, 10] == pytest.approx(0.5)
    assert recording.signal[middle, 10] == pytest.approx(60 / 0.5**2)
    assert recording.distance[0, 10] > 0.9


def test_a_sensor_that_turns_sweeps_a_marker_across_its_zones() -> None:
    path = way(8, (0, 0, 0), (0, 0, 0), (-15, 15))
    ahead = {'id': 2816, 'position': ['0 m', '0.1 m', '1 m']}
    recording = seen(7.9, sensor={'path': path}, markers=[ahead], surfaces=[WALL])
    blinking = np.array([block.std(axis=0) for block in np.array_split(recording.signal, 6)])
    assert blinking[0].argmax() % 4 == 3  # it looks to the left, so the marker is on the right
    assert blinking[-1].argmax() % 4 == 0
    # The wall is square to the axis in the middle of the sweep.
    middle = len(recording) // 2
    np.testing.assert_allclose(recording.distance[middle, 12:], 1.05, atol=0.01)
    assert recording.distance[0, 12] > recording.distance[0, 15]


def test_a_sensor_that_comes_nearer_sees_more() -> None:
    path = way(8, (0, 0, 0), (0, 0, 0.5))
    recording = seen(7.9, sensor={'path': path}, surfaces=[WALL])
    assert recording.distance[0, 5] == pytest.approx(1.05, abs=0.002)
    assert recording.distance[-1, 5] == pytest.approx(0.556, abs=0.005)
    assert recording.signal[-1, 5] == pytest.approx(40 * (1.05 / 0.556) ** 2, rel=0.02)
