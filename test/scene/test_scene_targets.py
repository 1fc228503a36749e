# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How a marker looks to a simulated sensor, and which target a zone reports."""

from dataclasses import replace

import numpy as np
import pytest
from harness_scene import BITS, BRIGHT, GRID, MARKER, RANGING, ZONE, simulate
from numpy.typing import NDArray

from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Occlusion, Sensor, Surface
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.model import Status


@pytest.mark.parametrize('zone', range(16))
def test_distance_is_along_the_axis_by_the_factor_of_the_zone(zone: int) -> None:
    x, y, z = (1.5 * GRID.directions[zone]).tolist()
    recording = simulate(Scene(markers=(replace(BRIGHT, position_m=(x, y, z)),)), 2)
    assert recording.distance[0, zone] == pytest.approx(1.5 * GRID.z_per_range[zone], rel=2e-3)


def test_a_dark_marker_without_a_wall_is_no_target_whatever_the_rounding() -> None:
    # Differences of long integrals of time are zero up to their last bits only.
    one = next(i for i in range(1, 4095) if packet(i)[-1] == 1)
    scene = Scene(sensor=Sensor(ranging=RANGING), markers=(replace(MARKER, id=one, response=None),))
    recording = simulate(scene, 14_000)
    seen = recording.status[:, ZONE] != Status.NO_TARGET
    assert recording.signal[seen, ZONE].min() > 0.01
    assert 0.2 < seen.mean() < 0.8


def test_occlusion_takes_its_share_of_light() -> None:
    scene = Scene(markers=(replace(BRIGHT, occlusion=Occlusion(every_s=0.5, lasting_s=0.05)),))
    signal = simulate(scene, 5000).signal[:, ZONE]
    assert signal.mean() == pytest.approx(360 * 0.9, rel=2e-3)
    assert np.isclose(signal, 360, rtol=1e-4).mean() == pytest.approx(1 - 0.071 / 0.5, abs=0.01)
    assert np.mean(signal == 0) == pytest.approx(0.029 / 0.5, abs=0.01)


def test_a_surface_is_seen_in_its_zones_only() -> None:
    recording = simulate(Scene(surfaces=(Surface(1, 5, zones=(2, 7)),)), 3)
    assert np.flatnonzero(recording.signal[0]).tolist() == [2, 7]
    # Nothing is known of what was before the first frame, so it is no first range.
    assert (recording.status[:, [2, 7]] == Status.VALID).all()
    assert not simulate(Scene(surfaces=(Surface(1, 5, zones=()),)), 3).signal.any()


def bright_and_dark(scene: Scene) -> tuple[Recording, NDArray[np.bool_], NDArray[np.bool_]]:
    """Simulate three packets; return frames wholly within bright and within dark bits, too."""
    recording = simulate(scene, 2 * 93)
    second_halves = np.arange(186) % 2 == 1
    dark = np.repeat(np.tile(BITS, 3), 2) == 1
    return recording, second_halves & ~dark, second_halves & dark


MERGED, VALID = Status.MERGED, Status.VALID
DEPTH_M = float(GRID.z_per_range[ZONE])


@pytest.mark.parametrize(
    ('wall', 'signal', 'distance_m', 'status'),
    [
        (Surface(2, 4), 360, DEPTH_M, VALID),
        (Surface(1.3, 90), 450, (360 * DEPTH_M + 90 * 1.3) / 450, MERGED),
    ],
    ids=['far', 'near'],
)
def test_a_wall_is_seen_by_a_dark_marker_and_merges_with_a_bright_one_if_it_is_near(
    wall: Surface, signal: float, distance_m: float, status: Status
) -> None:
    recording, bright, dark = bright_and_dark(Scene(markers=(MARKER,), surfaces=(wall,)))
    signals, distances = recording.signal[:, ZONE], recording.distance[:, ZONE]
    assert signals[bright] == pytest.approx(signal, rel=1e-3)
    assert distances[bright] == pytest.approx(distance_m, rel=1e-4)
    assert (recording.status[bright, ZONE] == status).all()
    assert signals[dark] == pytest.approx(wall.signal, abs=0.05)
    assert distances[dark] == pytest.approx(wall.distance_m, abs=1e-3)
    assert (recording.status[dark, ZONE] == VALID).all()
    assert set(recording.status[:, ZONE].tolist()) == {VALID, status}
    # The other zones see the wall only.
    assert (np.delete(recording.status, ZONE, axis=1) == VALID).all()


@pytest.mark.parametrize(
    ('targets', 'signal', 'distance_m', 'status'),
    [
        # They are separate from 600 mm on.
        ([(1, 50), (1.599, 40)], 90, 1 + 0.599 * 4 / 9, MERGED),
        ([(1, 50), (1.601, 40)], 50, 1, VALID),
        # A pulse is pure if one target makes 95 % of it.
        ([(1, 100), (1.1, 5)], 105, 1.1 - 10 / 105, VALID),
        ([(1, 100), (1.1, 5.5)], 105.5, 1.1 - 10 / 105.5, MERGED),
        # The strongest pulse counts, not the strongest target.
        ([(1, 50), (3, 40), (3.2, 40)], 80, 3.1, MERGED),
        # Something weak between two targets does not join them.
        ([(1, 50), (1.45, 0), (1.9, 40)], 50, 1, VALID),
        ([(1, 50), (1.45, 0.01), (1.9, 40)], 50.01, 1.0001, VALID),
        ([(1, 50), (1.45, 9), (1.9, 40)], 59, 1 + 9 * 0.45 / 59, MERGED),
    ],
)
def test_targets_make_one_pulse_or_several(
    targets: list[tuple[float, float]], signal: float, distance_m: float, status: Status
) -> None:
    recording = simulate(Scene(surfaces=tuple(Surface(*target) for target in targets)), 2)
    assert recording.signal == pytest.approx(signal)
    assert recording.distance == pytest.approx(distance_m, abs=1e-4)
    assert (recording.status == status).all()


@pytest.mark.parametrize(
    ('threshold', 'wall', 'usual'),
    [(5, Surface(2, 4), Status.VALID), (100, Surface(1.3, 90), Status.MERGED)],
)
def test_below_the_threshold_there_is_no_target_and_after_it_no_previous_one(
    threshold: float, wall: Surface, usual: Status
) -> None:
    sensor = Sensor(target_threshold=threshold)
    scene = Scene(sensor=sensor, markers=(MARKER,), surfaces=(wall,))
    recording, bright, dark = bright_and_dark(scene)
    status = recording.status[:, ZONE]
    absent = status == Status.NO_TARGET
    assert absent[dark].all()
    assert not absent[bright].any()
    assert (recording.signal[absent, ZONE] == 0).all()
    assert np.isnan(recording.distance[absent, ZONE]).all()
    first = ~absent[1:] & absent[:-1]
    assert first.any()
    assert (status[1:][first] == Status.NO_PREVIOUS_TARGET).all()
    assert (status[1:][~absent[1:] & ~first] == usual).all()
    # Where the wall alone is seen, it is too weak all the time.
    assert (recording.status[:, 0] == Status.NO_TARGET).all()
