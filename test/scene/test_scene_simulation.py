# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Noise, time, seeds and blocks of simulated frames; targets of zones; truth of what is read."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.detection import Place
from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Occlusion, Sensor, Surface, load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.scene.reference import NOISE, RANGING, RESPONSE
from retrolidar_ros.scene.truth import judge
from retrolidar_ros.sensor.frame import Recording, ZoneGrid
from retrolidar_ros.sensor.model import Status

GRID = ZoneGrid(4, 4)
ZONE = 10
X, Y, Z = GRID.directions[ZONE].tolist()
MARKER = Marker(id=2061, position_m=(X, Y, Z), name='m', response=RESPONSE)
# A bit and a frame of equal middles: each frame sees one half of a bit.
BITS = packet(2061)
# Bright for ever: its only packet begins after all that the tests look at.
BRIGHT = replace(MARKER, start_s=1e6)
EVERYTHING = load_scene(str(Path(__file__).with_name('every_key.yaml')))


def simulate(scene: Scene, frames: int) -> Recording:
    return Simulation(scene).advance(frames)


def wall(distance_m: float, signal: float, sensor: Sensor | None = None) -> Scene:
    return Scene(sensor=sensor or Sensor(), surfaces=(Surface(distance_m, signal),))


def assert_same(one: Recording, other: Recording) -> None:
    assert one.grid == other.grid
    for name in vars(one).keys() - {'grid'}:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def test_a_wall_is_reported_exactly() -> None:
    recording = simulate(replace(wall(2.5, 7.25), ambient=1.5), 20)
    assert (recording.distance == 2.5).all()
    assert (recording.signal == 7.25).all()
    assert (recording.ambient == 1.5).all()
    assert (recording.status == Status.VALID).all()
    assert recording.sequence.tolist() == list(range(20))
    assert recording.sensor_time_us == pytest.approx(21_000 * (np.arange(20) + 0.5), abs=0.5)
    assert (recording.stamp_ns == recording.sensor_time_us * 1000).all()


@pytest.mark.parametrize('signal', [30, 100, 700])
def test_noise_has_the_variance_of_the_measured_law(signal: float) -> None:
    recording = simulate(wall(1, signal, Sensor(noise=NOISE)), 8000)
    noise = recording.signal.astype(np.float64) - signal
    count = noise.size
    variance = 4.6 + 0.22 * signal
    # Four standard errors each: of a variance, a mean, and correlations.
    assert noise.var() == pytest.approx(variance, rel=4 * math.sqrt(2 / count))
    assert noise.mean() == pytest.approx(0, abs=4 * math.sqrt(variance / count))
    assert np.mean(noise[1:] * noise[:-1]) / variance == pytest.approx(0, abs=4 / math.sqrt(count))
    between_zones = np.corrcoef(noise.T) - np.eye(16)
    assert np.abs(between_zones).max() < 4.5 / math.sqrt(8000)
    assert np.mean(noise**4) / variance**2 == pytest.approx(3, abs=0.1)  # a normal distribution


@pytest.mark.parametrize(
    ('signal', 'measured_mm'),
    [(14, 35), (25, 22), (36, 14), (62, 7), (137, 4.2), (202, 3.1), (492, 1.9)],
)
def test_ranging_deviates_as_measured(signal: float, measured_mm: float) -> None:
    recording = simulate(wall(1.0, signal, Sensor(ranging=RANGING)), 3000)
    error_m = recording.distance.astype(np.float64) - 1.0
    sigma_m = math.hypot(0.49 / signal, 0.0016)
    assert error_m.std() == pytest.approx(sigma_m, rel=4 / math.sqrt(2 * error_m.size))
    assert error_m.std() * 1e3 == pytest.approx(measured_mm, rel=0.17)
    assert error_m.mean() == pytest.approx(0, abs=4 * sigma_m / math.sqrt(error_m.size))
    assert (recording.signal == signal).all()


def test_noise_is_independent_of_ranging_never_negative_and_before_the_threshold() -> None:
    recording = simulate(wall(1.0, 100, Sensor(noise=NOISE, ranging=RANGING)), 4000)
    matrix = np.corrcoef(recording.signal.ravel(), recording.distance.ravel())
    assert abs(matrix[0, 1]) < 4 / math.sqrt(recording.signal.size)
    recording = simulate(wall(1, 1, Sensor(noise=NOISE)), 1000)
    assert recording.signal.min() == 0
    assert (recording.status == Status.VALID).all()
    recording = simulate(wall(1, 20, Sensor(noise=NOISE, target_threshold=20)), 4000)
    absent = recording.status == Status.NO_TARGET
    assert absent.mean() == pytest.approx(0.5, abs=4 * 0.5 / math.sqrt(absent.size))
    assert recording.signal[~absent].min() >= 20
    assert (np.isnan(recording.distance) == absent).all()


@pytest.mark.parametrize('error', [-0.0036, 0.0, 0.05])
def test_errors_are_of_the_true_period_and_of_the_stamps_only(error: float) -> None:
    simulation = Simulation(wall(1, 9, Sensor(period_error=error)))
    times_us = simulation.advance(1001).sensor_time_us
    assert times_us[-1] - times_us[0] == pytest.approx(21e6 * (1 + error), abs=1)
    assert simulation.period_s == 0.021 * (1 + error)
    scene = Scene(markers=(MARKER,))
    fast = replace(scene, sensor=Sensor(clock_error=error))
    one, other = simulate(scene, 500), simulate(fast, 500)
    assert other.sensor_time_us == pytest.approx((1 + error) * one.sensor_time_us, abs=1)
    np.testing.assert_array_equal(one.signal, other.signal)


def test_jitter_moves_what_is_seen_with_the_stamp() -> None:
    scene = Scene(sensor=Sensor(jitter_s=1e-3), markers=(replace(MARKER, response=None),))
    recording = simulate(scene, 2000)
    end_s = recording.sensor_time_us * 1e-6 + 0.0105
    bit, within_s = np.divmod(end_s, 0.042)
    began_bright, ends_bright = 1 - BITS[np.stack([bit - 1, bit]).astype(int) % 31]
    brightens = (began_bright < ends_bright) & (within_s < 0.021)
    assert brightens.sum() > 50
    bright_share = within_s[brightens] / 0.021
    assert recording.signal[brightens, ZONE] / 360 == pytest.approx(bright_share, abs=1e-4)


def test_lost_frames_are_gaps_in_the_sequence() -> None:
    scene = Scene(seed=8, markers=(MARKER,), surfaces=(Surface(2, 4),))
    recording = simulate(replace(scene, sensor=Sensor(lost=0.2)), 20_000)
    share = 1 - len(recording) / 20_000
    assert share == pytest.approx(0.2, abs=4 * math.sqrt(0.2 * 0.8 / 20_000))
    assert (np.diff(recording.sequence) > 0).all()
    # They are lost one by one, and the others keep their times and what they saw.
    expected_us = 21_000 * (recording.sequence + 0.5)
    assert recording.sensor_time_us == pytest.approx(expected_us, abs=0.6)
    gaps = np.diff(recording.sequence) - 1
    assert gaps.mean() == pytest.approx(0.25, rel=0.05)
    assert np.mean(gaps > 0) == pytest.approx(0.2, abs=0.015)
    whole = simulate(scene, 20_000)
    np.testing.assert_array_equal(recording.signal, whole.signal[recording.sequence])
    # All may be.
    simulation = Simulation(replace(EVERYTHING, sensor=replace(EVERYTHING.sensor, lost=1.0)))
    assert [len(simulation.advance(100)) for _ in range(2)] == [0, 0]


def test_abnormal_samples_have_their_share_and_mean_nothing() -> None:
    recording = simulate(wall(1, 500, Sensor(abnormal=0.24)), 4000)
    abnormal = recording.status != Status.VALID
    assert abnormal.mean() == pytest.approx(0.24, abs=4 * math.sqrt(0.24 * 0.76 / abnormal.size))
    assert set(recording.status[abnormal].tolist()) == {0, 1, 3, 4, 7, 8, 11}
    assert (recording.signal[~abnormal] == 500).all()
    assert (recording.distance[~abnormal] == 1).all()
    assert recording.signal[abnormal].max() < 101
    assert 0 <= recording.distance[abnormal].min() < recording.distance[abnormal].max() < 4.01


def test_frames_depend_on_the_seed_only() -> None:
    one = simulate(EVERYTHING, 300)
    assert_same(one, simulate(EVERYTHING, 300))
    assert_same(one, Simulation(EVERYTHING, np.random.default_rng(EVERYTHING.seed)).advance(300))
    other = simulate(replace(EVERYTHING, seed=4), 300)
    assert len(other) != len(one) or not np.array_equal(other.signal, one.signal)


@pytest.mark.parametrize('split', [1, 2, 37, 100, 101])
def test_blocks_have_no_seam(split: int) -> None:
    by_chance = ('jitter_s', 'noise', 'ranging', 'lost', 'abnormal')
    without = {name: getattr(Sensor(), name) for name in by_chance}
    sensor = replace(EVERYTHING.sensor, target_threshold=20.0, **without)
    scene = replace(EVERYTHING, sensor=sensor)
    whole = simulate(scene, 200)
    assert Status.NO_PREVIOUS_TARGET in whole.status
    simulation = Simulation(scene)
    parts = [simulation.advance(split), simulation.advance(200 - split)]
    assert_same(Recording.of([frame for part in parts for frame in part]), whole)


def test_truth_is_the_range_at_the_stamp() -> None:
    scene = load_scene('drone')
    (marker,) = scene.markers
    recording = Simulation(scene).run(14.0)
    origin_ns = int(recording.stamp_ns[0])
    end_ns = int(recording.stamp_ns[-10])
    stamp_ns = int(recording.stamp_ns[-40])
    sensor_s = recording.sensor_time_us[-40:-39] * 1e-6
    places = position_at(marker, sensor_s / (1 + scene.sensor.clock_error))
    truth = float(np.linalg.norm(places))
    covariance = np.diag([0.05, 0.05, 0.005, 1, 1, 1]) ** 2
    place = Place(places[0] + (0.06, 0, 0), np.eye(4)[3], covariance, truth + 0.004, 0.005)
    read = create_detector('joint', recording.grid).update_all(recording)[-1]
    start_ns = end_ns - round(1.302e9)
    reading = replace(read, start_ns=start_ns, stamp_ns=stamp_ns, end_ns=end_ns, place=place)
    ghost = replace(reading, id=7)
    outcome, other = judge(scene, recording, [reading, ghost])
    assert outcome.range_m == pytest.approx(truth, abs=3e-4)
    assert outcome.error_m == pytest.approx(0.004, abs=3e-4)
    assert outcome.place_error_m == pytest.approx(0.06, abs=1e-3)
    assert outcome.place_stddev_m == pytest.approx(0.05)
    assert outcome.good
    sure = replace(reading, place=replace(place, covariance=np.eye(6) * 1e-4))
    (missed, _) = judge(scene, recording, [sure, ghost])
    assert (missed.is_placed, missed.good) == (False, False)
    assert outcome.first_reading_s == pytest.approx((end_ns - origin_ns) * 1e-9)
    assert (other.id, other.name, other.good) == (7, 'ghost', False)
    (unread,) = judge(scene, recording, [])
    assert (unread.readings, unread.good) == (0, False)


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
