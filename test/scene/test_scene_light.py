# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Light in scenes: budget, zones, crystal, hands, moving sensors, glass and neighbours."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from harness_frames import both_grids

from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene import Simulation, parse_scene
from retrolidar_ros.scene.description import Marker, Response, Wander
from retrolidar_ros.scene.optics import position_at, received_signal, zone_shares
from retrolidar_ros.scene.reference import RESPONSE
from retrolidar_ros.scene.transmission import Transmission
from retrolidar_ros.sensor.frame import Recording, ZoneGrid
from retrolidar_ros.settings.section import Triple

AREA_M2 = 0.03**2
RESTING = Marker(id=5, position_m=(0.1, -0.2, 1.5), name='m')


def received(range_m: float = 1.0, area_m2: float = AREA_M2, yaw_deg: float = 0.0) -> float:
    return float(received_signal(np.array(range_m), area_m2, math.radians(yaw_deg)))


def test_link_budget_of_the_paper() -> None:
    for metres, signal in ((1.0, 360), (1.4, 100), (2.0, 26), (2.6, 9.5)):
        assert received(metres) == pytest.approx(signal, rel=0.01)
    range_m = np.geomspace(0.5, 4, 50)
    slope = np.diff(np.log(received_signal(range_m, AREA_M2, 0))) / np.diff(np.log(range_m))
    assert slope == pytest.approx(-3.8)
    assert received(1.3, AREA_M2 / 3) == pytest.approx(received(1.3) / 3)


def test_yaw_is_good_to_50_and_dead_from_60_degrees() -> None:
    degrees = np.arange(-90, 91)
    at_yaw = np.array([received(yaw_deg=float(one)) for one in degrees])
    assert at_yaw == pytest.approx(at_yaw[::-1])
    good, dead = np.abs(degrees) <= 50, np.abs(degrees) >= 60
    # Up to there only the projected area shrinks.
    assert at_yaw[good] == pytest.approx(received() * np.cos(np.radians(degrees[good])))
    assert (at_yaw[dead] == 0).all()
    assert (np.diff(at_yaw[(degrees >= 0) & (degrees <= 60)]) < 0).all()
    assert (at_yaw >= 0).all()


@both_grids
@pytest.mark.parametrize('blur', [0.0, 0.05, 0.3])
@pytest.mark.parametrize(
    ('position', 'size'),
    [
        ((0.0, 0.0, 1.0), 0.03),  # between four zones
        ((0.21, -0.09, 1.0), 0.03),
        ((-0.43, 0.3, 1.0), 0.03),  # half out of sight
        ((0.3, -0.86, 2.0), 0.3),
        ((0.0, 0.0, 1.0), 1.0),  # larger than all zones
        ((0.7, 0.0, 1.0), 0.03),  # out of sight
    ],
)
def test_shares_are_those_of_scattered_points(
    grid: ZoneGrid, blur: float, position: tuple[float, float, float], size: float
) -> None:
    shares = zone_shares(np.array([position]), size, grid, blur)
    assert shares.shape == (1, grid.zones)
    # Points of the marker, each blurred, are counted in the zone where they are seen.
    rng = np.random.default_rng(4)
    points = np.array(position[:2]) + size * rng.uniform(-0.5, 0.5, (80_000, 2))
    tangents = points / position[2] + blur * grid.pitch * rng.standard_normal(points.shape)
    index = np.floor(tangents / grid.pitch + grid.columns / 2).astype(int)
    inside = ((index >= 0) & (index < grid.columns)).all(axis=-1)
    zone = index[inside, 1] * grid.columns + index[inside, 0]
    counted = np.bincount(zone, minlength=grid.zones) / len(points)
    # Four standard deviations of a share of one half.
    assert shares[0] == pytest.approx(counted, abs=7.1e-3)


def test_wander_is_slow_smooth_and_bounded() -> None:
    assert position_at(RESTING, np.arange(5.0)).tolist() == [[0.1, -0.2, 1.5]]  # at rest
    wander = Wander(across_m=0.12, along_m=0.02, period_s=13)
    time_s = np.arange(0, 1300, 0.1)
    away = position_at(replace(RESTING, wander=wander), time_s) - RESTING.position_m
    assert away.shape == (len(time_s), 3)
    amplitude = np.array([0.12, 0.12, 0.02])
    assert np.abs(away).max(axis=0) == pytest.approx(amplitude, rel=1e-3)
    assert np.abs(away.mean(axis=0)) == pytest.approx(0, abs=2e-3)
    speed = np.abs(np.diff(away, axis=0)).max(axis=0) / 0.1
    assert (speed <= 1.0001 * amplitude * 2 * np.pi / 13).all()


SHARP = Marker(id=2061, position_m=(0, 0, 1), name='m')
MARKER = replace(SHARP, response=RESPONSE)
ENDS_DARK = next(identity for identity in range(1, 4095) if packet(identity)[-1])


MARKERS = [
    MARKER,
    SHARP,
    replace(MARKER, start_s=0.3),
    replace(MARKER, start_s=0.25, packets=1),
    replace(MARKER, packets=2, gap_bits=3),
    replace(MARKER, id=2730, bit_period_s=0.02, gap_bits=1),
    replace(MARKER, id=0, clock_error=-0.05, gap_bits=40),
    replace(MARKER, id=4095, clock_error=0.05),
    replace(MARKER, bit_period_s=0.0071),
    replace(MARKER, id=ENDS_DARK, packets=1),  # its last bit fades out
]


@pytest.mark.parametrize('marker', MARKERS)
def test_light_is_that_of_a_crystal_stepped_through_time(marker: Marker) -> None:
    bits = np.array([*packet(marker.id), *[0] * marker.gap_bits])
    response = marker.response or Response(dark_s=1e-9, bright_s=1e-9)
    step_s = 5e-5
    # A first-order crystal; an exponential runs from 10 to 90 % in τ (ln 10 - ln 10/9).
    darker = 1 - math.exp(-step_s * math.log(9) / response.dark_s)
    brighter = 1 - math.exp(-step_s * math.log(9) / response.bright_s)
    times = np.arange(0, 3.0, step_s)
    within = times + step_s / 2 - marker.start_s
    sent = np.floor(within / (marker.bit_period_s * (1 + marker.clock_error))).astype(int)
    silent = (sent < 0) | (sent >= (marker.packets or 10**9) * len(bits))
    goals = np.where(silent, 1.0, 1.0 - bits[sent % len(bits)])
    levels = np.empty_like(times)
    level = 1.0
    for index, goal in enumerate(goals.tolist()):
        levels[index] = level
        level += (goal - level) * (darker if goal < level else brighter)
    integral = np.cumsum((levels[1:] + levels[:-1]) / 2 * step_s)
    slices_s = np.column_stack([times[:-1], times[1:]])
    computed = np.cumsum(Transmission.of(marker).mean(slices_s) * step_s)
    # In bits of two response times the crystal does not quite settle, which is neglected.
    error_s = 1e-4 if marker.bit_period_s > 0.01 else 1e-3
    assert np.abs(computed - integral).max() < error_s


IN_ZONE_10 = {'id': 2816, 'position': ['0.107 m', '0.107 m', '1 m']}
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
    half = {**IN_ZONE_10, 'contrast': '80 %', 'signal_at_1_m': '200 kcps/SPAD'}
    signal = seen(markers=[half]).signal[:, 10]
    assert signal.min() / signal.max() == pytest.approx(0.2, abs=0.001)
    assert signal.max() == pytest.approx(200 * (1 + 2 * 0.107**2) ** -1.9, rel=0.01)


def test_offset_dead_time_and_crosstalk_are_those_of_the_sensor() -> None:
    ranging = {'shot': '0 m', 'floor': '0 m', 'offset': '20 mm'}
    distance = seen(1, sensor={'ranging': ranging}, surfaces=[WALL]).distance[0]
    assert distance[[0, 5]] == pytest.approx(1.05 + 0.02 * np.array([0.9072, 0.9851]), abs=2e-4)
    # What is bright is bent.
    bright = {'distance': '0.3 m', 'signal': '1000 kcps/SPAD', 'zones': [0]}
    signal = seen(1, sensor={'saturation': '3000 kcps/SPAD'}, surfaces=[WALL, bright]).signal[0]
    assert signal[0] == pytest.approx(1000 / (1 + 1000 / 3000))
    assert signal[5] == pytest.approx(40 / (1 + 40 / 3000))
    # Crosstalk is a target where nothing is brighter.
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
    recording = seen(4, markers=[IN_ZONE_10], surfaces=[WALL], moving_surfaces=[hand])
    middle = len(recording) // 2
    assert recording.distance[middle, 10] == pytest.approx(0.5)
    assert recording.signal[middle, 10] == pytest.approx(60 / 0.5**2)
    assert recording.distance[0, 10] > 0.9


def test_a_sensor_that_turns_or_comes_nearer_sees_other_things() -> None:
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
    nearer = seen(7.9, sensor={'path': way(8, (0, 0, 0), (0, 0, 0.5))}, surfaces=[WALL])
    assert nearer.distance[[0, -1], 5] == pytest.approx([1.05, 0.556], abs=0.005)
    assert nearer.signal[-1, 5] == pytest.approx(40 * (1.05 / 0.556) ** 2, rel=0.02)
