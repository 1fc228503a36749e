# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How a marker looks to a simulated sensor."""

import math
from dataclasses import replace

import numpy as np
import pytest
from harness_scene import BITS, BRIGHT, CENTRE, GRID, MARKER, RANGING, ZONE, simulate

from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, Occlusion, Sensor, Wander
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import Floats, Status


def at(position_m: Floats) -> Marker:
    """Return the bright marker at a position, shape (3,) [m]."""
    x, y, z = position_m.tolist()
    return replace(BRIGHT, position_m=(x, y, z))


@pytest.mark.parametrize('range_m', [1.0, 2.0, 2.6])
def test_a_bright_marker_has_the_signal_of_the_link_budget(range_m: float) -> None:
    recording = simulate(Scene(markers=(at(range_m * CENTRE),)), 5)
    assert recording.signal[:, ZONE] == pytest.approx(360 * range_m**-3.8, rel=1e-4)
    assert np.flatnonzero(recording.signal[0]).tolist() == [ZONE]
    assert recording.distance[:, ZONE] == pytest.approx(range_m * GRID.z_per_range[ZONE])


@pytest.mark.parametrize('zone', range(16))
def test_distance_is_along_the_axis_by_the_factor_of_the_zone(zone: int) -> None:
    position = 1.5 * GRID.directions[zone] + [0.02, -0.01, 0]
    recording = simulate(Scene(markers=(at(position),)), 2)
    # UM3109 has one factor for the corners, one for the edges and one for the middle.
    row, column = divmod(zone, 4)
    factor = [0.9851, 0.9438, 0.9072][(row in (0, 3)) + (column in (0, 3))]
    expected = float(np.linalg.norm(position)) * factor
    assert recording.distance[0, zone] == pytest.approx(expected, rel=2e-3)


def test_two_frames_a_bit_read_the_packet_but_the_crystal_needs_time() -> None:
    recording = simulate(Scene(markers=(replace(MARKER, response=None),)), 2 * 62)
    expected = 1 - np.repeat(np.tile(BITS, 2), 2)
    assert recording.signal[:, ZONE] == pytest.approx(360.0 * expected, rel=1e-4)
    recording = simulate(Scene(markers=(MARKER,)), 2 * 31)
    signal = recording.signal[:, ZONE].reshape(31, 2) / 360
    edges = np.diff([0, *BITS])
    tau_share = 1e-3 / math.log(9) / 0.021
    assert signal[edges == 1, 0] == pytest.approx(0.5 * tau_share, rel=1e-3)
    assert signal[edges == -1, 0] == pytest.approx(1 - 3.5 * tau_share, rel=1e-3)
    assert signal[:, 1] == pytest.approx(1 - BITS, abs=1e-4)


def test_a_dark_marker_without_a_wall_is_no_target_whatever_the_rounding() -> None:
    # Differences of long integrals of time are zero up to their last bits only.
    identity = next(i for i in range(1, 4095) if packet(i)[-1] == 1)
    scene = Scene(
        sensor=Sensor(ranging=RANGING), markers=(replace(MARKER, id=identity, response=None),)
    )
    recording = simulate(scene, 14_000)
    seen = recording.status[:, ZONE] != Status.NO_TARGET
    assert recording.signal[seen, ZONE].min() > 0.01
    assert 0.2 < seen.mean() < 0.8


def test_wander_moves_signal_and_distance_and_across_changes_zones() -> None:
    along = Wander(across_m=0.0, along_m=0.2, period_s=2)
    recording = simulate(Scene(markers=(replace(BRIGHT, wander=along),)), 1000)
    range_m = recording.distance[:, ZONE].astype(np.float64) / GRID.z_per_range[ZONE]
    assert [range_m.min(), range_m.max()] == pytest.approx([0.8, 1.2], abs=0.01)
    # While it moves along the axis it leaves the middle of the zone, but not the zone.
    assert recording.signal[:, ZONE] == pytest.approx(360 * range_m**-3.8, rel=1e-4)
    across = Wander(across_m=0.3, along_m=0, period_s=4)
    marker = replace(BRIGHT, position_m=(0, 0, 1), wander=across)
    recording = simulate(Scene(markers=(marker,)), 3000)
    assert (recording.signal.max(axis=0) > 100).sum() > 6
    position_m = position_at(marker, recording.sensor_time_us * 1e-6)
    expected = 360 * np.linalg.norm(position_m, axis=-1) ** -3.8
    assert recording.signal.sum(axis=1) == pytest.approx(expected, rel=1e-4)


def test_occlusion_takes_its_share_of_light() -> None:
    scene = Scene(markers=(replace(BRIGHT, occlusion=Occlusion(every_s=0.5, lasting_s=0.05)),))
    signal = simulate(scene, 5000).signal[:, ZONE]
    assert signal.mean() == pytest.approx(360 * 0.9, rel=2e-3)
    assert np.isclose(signal, 360, rtol=1e-4).mean() == pytest.approx(1 - 0.071 / 0.5, abs=0.01)
    assert np.mean(signal == 0) == pytest.approx(0.029 / 0.5, abs=0.01)
