# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which target a zone reports, and with which status."""

import numpy as np
import pytest
from harness_scene import BITS, GRID, MARKER, NOISE, RANGING, ZONE, simulate
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Sensor, Surface
from retrolidar_ros.sensor.frame import Recording, Status


@pytest.mark.parametrize('sensor', [Sensor(), Sensor(noise=NOISE, ranging=RANGING)])
def test_nothing_to_see_is_no_target(sensor: Sensor) -> None:
    recording = simulate(Scene(sensor=sensor), 50)
    assert recording.distance.shape == (50, 16)
    assert (recording.status == Status.NO_TARGET).all()
    assert np.isnan(recording.distance).all()
    assert not recording.signal.any()
    assert not recording.ambient.any()


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


def test_distance_flips_to_a_wall_far_behind_a_dark_marker() -> None:
    recording, bright, dark = bright_and_dark(Scene(markers=(MARKER,), surfaces=(Surface(2, 4),)))
    signal, distance = recording.signal[:, ZONE], recording.distance[:, ZONE]
    assert signal[bright] == pytest.approx(360, rel=1e-3)
    assert distance[bright] == pytest.approx(GRID.z_per_range[ZONE])
    assert signal[dark] == pytest.approx(4)
    assert (distance[dark] == 2).all()
    # So far from each other, no pulse is ever a merged one.
    assert (recording.status == Status.VALID).all()


def test_a_wall_near_behind_the_marker_merges_with_it() -> None:
    scene = Scene(markers=(MARKER,), surfaces=(Surface(1.3, 90),))
    recording, bright, dark = bright_and_dark(scene)
    signal, distance = recording.signal[:, ZONE], recording.distance[:, ZONE]
    assert signal[bright] == pytest.approx(450, rel=1e-3)
    assert distance[bright] == pytest.approx(
        (360 * GRID.z_per_range[ZONE] + 90 * 1.3) / 450, rel=1e-4
    )
    assert (recording.status[bright, ZONE] == Status.MERGED).all()
    assert signal[dark] == pytest.approx(90, abs=0.05)
    assert distance[dark] == pytest.approx(1.3, abs=1e-3)
    assert (recording.status[dark, ZONE] == Status.VALID).all()
    # The other zones see the wall only.
    elsewhere = np.delete(recording.status, ZONE, axis=1)
    assert (elsewhere == Status.VALID).all()


MERGED, VALID = Status.MERGED, Status.VALID


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


@settings(max_examples=60, deadline=None, derandomize=True)
@given(
    st.lists(st.tuples(st.floats(0.1, 4), st.sampled_from([0.0, 1.0, 5.0, 7.0, 50.0])), max_size=5)
)
def test_the_pulse_holds_or_outshines_the_strongest_target(
    targets: list[tuple[float, float]],
) -> None:
    recording = simulate(Scene(surfaces=tuple(Surface(*target) for target in targets)), 1)
    reported = float(recording.signal[0, 0])
    strongest = max((signal for _, signal in targets), default=0.0)
    assert strongest * (1 - 1e-6) <= reported <= sum(signal for _, signal in targets) + 1e-6
    if strongest == 0:
        assert recording.status[0, 0] == Status.NO_TARGET
        return
    distance = float(recording.distance[0, 0])
    shining = [z for z, signal in targets if signal]
    assert min(shining) - 1e-6 <= distance <= max(shining) + 1e-6
    # The order in which a scene names its surfaces does not matter.
    again = simulate(Scene(surfaces=tuple(Surface(*target) for target in targets[::-1])), 1)
    assert again.signal[0, 0] == pytest.approx(reported)


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
