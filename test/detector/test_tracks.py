# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from harness_frames import GRID, ID, OTHER_ID, ZONE, a_scene, repeating, rms, simulate
from numpy.typing import NDArray

from evaluation.bench.following import two_in_a_zone
from evaluation.bench.places import ELLIPSOID
from evaluation.bench.room_tracks import follow_room
from evaluation.experiments.tracks import moving_errors
from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.detection import Track
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Ranging, Surface, Wander, Waypoint, load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.scene.reference import RANGING, SENSOR
from retrolidar_ros.sensor.frame import Frame, Recording
from retrolidar_ros.sensor.model import VL53L8CX

KNOWN_S = 2.0  # a marker that repeats is read before
GONE_S = 0.6


def follow(frames: Iterable[Frame], **options: Any) -> tuple[LikelihoodDetector, list[list[Track]]]:
    """Give frames to a detector; return it, and the tracks at each frame."""
    detector = create_detector('joint', GRID, **options)
    assert isinstance(detector, LikelihoodDetector)
    tracks = []
    for frame in frames:
        detector.update(frame)
        tracks.append(detector.follow(frame))
    return detector, tracks


def ranging_scene(**marker: object) -> Scene:
    """Return a scene of a marker that repeats, with the ranging noise of the sensor."""
    scene = a_scene(start_s=0.0, packets=None, **marker)
    return replace(scene, sensor=replace(scene.sensor, ranging=RANGING))


def steady(scene: Scene, seconds: float) -> list[Track]:
    """Return the tracks of a scene, a second after they began to be followed."""
    _, tracks = follow(simulate(scene, seconds))
    every = [one for frame in tracks for one in frame]
    return [one for one in every if one.stamp_ns - every[0].stamp_ns > 1e9]


def stamps_s(tracks: list[list[Track]], marker: int = ID) -> list[float]:
    return [1e-9 * one.stamp_ns for frame in tracks for one in frame if one.id == marker]


def errors(scene: Scene, tracks: list[Track]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the errors of ranges [m], and the same in standard deviations."""
    truth = position_at(scene.markers[0], np.array([1e-9 * one.stamp_ns for one in tracks]))
    truth_m = np.linalg.norm(truth, axis=1)
    error = np.array([one.place.range_m for one in tracks]) - truth_m
    return error, error / np.array([one.place.range_stddev_m for one in tracks])


def test_a_marker_that_stands_is_known_to_a_millimetre_with_every_frame() -> None:
    scene = ranging_scene()
    found = steady(scene, 8.0)
    error, scaled = errors(scene, found)
    assert len(found) > 0.95 * (len(simulate(scene, 8.0)) - (KNOWN_S + 1.0) / SENSOR.period_s)
    assert rms(error) < 5e-4
    assert 0.4 < rms(scaled) < 1.5


@pytest.mark.parametrize('along_m', [0.05, 0.15, 0.3])
def test_a_marker_that_comes_and_goes_is_followed_within_its_deviation(along_m: float) -> None:
    scene = ranging_scene(wander=Wander(across_m=0.0, along_m=along_m, period_s=2.0))
    found = steady(scene, 12.0)
    error, scaled = errors(scene, found)
    bright = np.array([one.last_ns == one.stamp_ns for one in found])
    assert rms(error[bright]) < 8e-3
    assert 0.6 < rms(scaled[bright]) < 1.6
    assert 0.6 < rms(scaled) < 1.6
    # Its velocity is that of its range.
    speed = np.array([one.velocity @ one.place.position_m / one.place.range_m for one in found])
    times_s = np.array([1e-9 * one.stamp_ns for one in found])
    ranges_m = np.linalg.norm(position_at(scene.markers[0], times_s), axis=1)
    true = np.gradient(ranges_m, times_s)
    assert rms(speed - true) < 0.35 * rms(true) + 0.02


def test_a_marker_that_turns_round_at_once_is_followed() -> None:
    rng = np.random.default_rng(5600)
    runs = [moving_errors('to and fro', 0.6, 1.0, rng)['all'] for _ in range(4)]
    assert rms(np.concatenate(runs)) < 0.04


@pytest.mark.parametrize(('period_s', 'most'), [(6.0, 1.0), (3.0, 1.2)])
def test_a_marker_that_crosses_the_view_is_in_its_deviation(period_s: float, most: float) -> None:
    scene = ranging_scene(wander=Wander(across_m=0.3, along_m=0.0, period_s=period_s))
    found = steady(scene, 20.0)
    truth = position_at(scene.markers[0], np.array([1e-9 * one.stamp_ns for one in found]))
    off = [one.place.position_m - true for one, true in zip(found, truth, strict=True)]
    squared = [
        e @ np.linalg.solve(one.place.covariance[:3, :3], e)
        for e, one in zip(off, found, strict=True)
    ]
    assert 0.3 < np.mean(squared) / 3 < most


def lasting_s(after: Recording, frame: int) -> tuple[float, list[list[Track]]]:
    """Show a marker that repeats, and from a frame on something else.

    Return for how long after that it is followed [s], and the tracks at each frame.
    """
    before = [*repeating(8.0)][:frame]
    _, tracks = follow([*before, *[*after][frame:]])
    assert tracks[frame - 1]
    return max(stamps_s(tracks)) - 1e-9 * int(after.stamp_ns[frame]), tracks


def test_a_rate_of_range_begins_right_however_short_the_exposure_is() -> None:
    model = replace(VL53L8CX, exposure=0.3)
    x, y, z = a_scene().markers[0].position_m
    path = tuple(Waypoint(6.0 * to, (by * x, by * y, by * z)) for to, by in enumerate((0.8, 2.0)))
    scene = ranging_scene(path=path, position_m=(math.nan,) * 3)
    _, tracks = follow(simulate(scene), sensor=model)
    first = next(one for frame in tracks for one in frame)
    rate_m_s = float(first.velocity @ first.place.position_m) / first.place.range_m
    assert rate_m_s == pytest.approx(0.2 * math.sqrt(x * x + y * y + z * z), rel=0.3)


def test_what_vanishes_is_dropped_in_six_tenths_of_a_second() -> None:
    nothing = simulate(replace(a_scene(), markers=()), 8.0)
    lasting = [lasting_s(nothing, frame)[0] for frame in range(280, 340, 6)]
    assert np.median(lasting) < GONE_S
    assert max(lasting) < 2 * GONE_S


@pytest.mark.parametrize('start_s', [0.5, 0.51, 0.52, 0.53])
def test_a_marker_that_ends_but_stays_bright_is_dropped_within_a_second(start_s: float) -> None:
    """Light in its dark bits may be of another marker, but not for long and just as bright."""
    scene = load_scene('drone')
    (marker,) = scene.markers
    marker = replace(marker, wander=None, occlusion=None, start_s=start_s, packets=4)
    _, tracks = follow(simulate(replace(scene, markers=(marker,)), 10.0))
    silent_s = start_s + 4 * PACKET_BITS * marker.bit_period_s
    assert max(stamps_s(tracks, marker.id)) - silent_s < 1.0


def test_a_marker_that_sends_another_id_is_followed_no_longer() -> None:
    """It is gone sooner than one that is hidden would be."""
    other = simulate(a_scene(start_s=0.0, packets=None, id=OTHER_ID), 8.0)
    lasting = []
    for frame in range(285, 335, 4):
        own_s, tracks = lasting_s(other, frame)
        lasting.append(own_s)
        assert {one.id for one in tracks[-1]} == {OTHER_ID}
    assert np.mean(lasting) < 0.45
    assert max(lasting) < 1.0


def test_a_packet_alone_is_followed_only_until_no_other_comes() -> None:
    _, tracks = follow(simulate(a_scene(start_s=0.5), 5.0))
    assert np.ptp(stamps_s(tracks)) < GONE_S  # of none there is no ptp


@pytest.mark.parametrize('hidden_s', [0.1, 0.3])
def test_a_hand_and_lost_frames_end_no_track(hidden_s: float) -> None:
    frames = [*repeating(8.0)]
    end = 300 + round(hidden_s / SENSOR.period_s)
    bright, near = np.full(GRID.zones, 1700, np.float32), np.full(GRID.zones, 0.3, np.float32)
    hidden = [replace(frame, signal=bright, distance=near) for frame in frames[300:end]]
    for seen in (hidden, []):
        detector, tracks = follow([*frames[:300], *seen, *frames[end:]])
        assert len(tracks[299]) == len(tracks[-1]) == 1
        assert detector.counts.tracks_ended == 0


@pytest.mark.parametrize('apart_m', [0.0, 0.3])
def test_two_markers_in_a_zone_share_its_light(apart_m: float) -> None:
    rng = np.random.default_rng([5200, round(10 * apart_m)])
    runs = [two_in_a_zone(1.0, apart_m, 'from the start', 15.0, rng) for _ in range(4)]
    both = [value for one in runs for value in one['both']]
    errors_m = [value for one in runs for value in one['errors_m']]
    assert len(both) > 1350
    assert np.mean(both) > 0.7
    assert np.median(np.abs(errors_m)) < 2e-3


@pytest.mark.parametrize(
    ('room', 'min_followed', 'max_outside', 'max_false'),
    [
        (5, 0.885, 0.19, 340),  # of 10440 frames
        (19, 0.98, 0.05, 20),
        (27, 0.62, 0.085, 20),
        (36, 0.99, 0.06, 40),
        (37, 0.92, 0.19, 110),
        (44, 0.45, 0.17, 50),
        (52, 0.98, 0.01, 24),
    ],
)
def test_markers_in_a_random_room_are_followed(
    room: int, min_followed: float, max_outside: float, max_false: int
) -> None:
    """Each part of the core that follows markers is needed in one of these rooms."""
    followed = follow_room(room, 2888413288)
    off = [one for marker in followed.markers for one in marker.off]
    outside = [one.squared_distance > ELLIPSOID for one in off]
    assert len(off) > min_followed * sum(one.frames for one in followed.markers)
    assert np.mean(outside) < max_outside
    assert followed.false < max_false


@pytest.mark.parametrize('jump_s', [-5.0, 2.0, 100.0])
def test_no_track_outlives_a_jump_of_time(jump_s: float) -> None:
    recording = repeating(8.0)
    detector, tracks = follow(recording)
    assert len(tracks[-1]) == 1
    # Of two frames, as nobody asks for tracks at each.
    for frame in [*recording][-2:]:
        later = replace(frame, stamp_ns=frame.stamp_ns + round(1e9 * jump_s))
        detector.update(later)
    assert not detector.follow(later)
    assert detector.counts.tracks_ended == 1


def test_the_background_moves_no_range() -> None:
    """A wall half a metre behind merges with the marker, and is subtracted."""
    scene = ranging_scene(position_m=a_scene().markers[0].position_m)
    depth_m = scene.surfaces[0].distance_m
    behind = replace(scene, surfaces=(Surface(depth_m + 0.4, 40.0),))
    error, _ = errors(behind, steady(behind, 15.0)[200:])
    assert rms(error) < 0.015


def test_the_noise_of_distances_is_learnt() -> None:
    scene = ranging_scene(wander=Wander(across_m=0.0, along_m=0.05, period_s=4.0))
    noisy = Ranging(shot=4 * RANGING.shot, floor=4 * RANGING.floor)
    scene = replace(scene, sensor=replace(scene.sensor, ranging=noisy))
    _, scaled = errors(scene, steady(scene, 20.0)[300:])
    assert 0.5 < rms(scaled) < 1.5


@pytest.mark.parametrize('range_m', [1.0, 1.5])
def test_another_marker_that_is_unknown_ends_no_track(range_m: float) -> None:
    """It begins to send beside one that is followed: its light is no new level, nor its range."""
    rng = np.random.default_rng(5400)
    runs = [two_in_a_zone(range_m, 0.1, 'after 3 to 5 s', 8.0, rng) for _ in range(6)]
    assert sum(one['ends'] for one in runs) <= 3
    assert rms(np.concatenate([one['errors_m'] for one in runs])) < 0.04


def test_a_marker_that_is_three_times_as_bright_at_once_is_followed() -> None:
    """As one that flips towards the sensor: its gains are scaled."""
    recording = simulate(a_scene(start_s=0.0, packets=None), 12.0)
    signal = recording.signal.copy()
    signal[300:, ZONE] = 4.0 + 3.0 * (signal[300:, ZONE] - 4.0)
    detector, tracks = follow(replace(recording, signal=signal))
    assert len(tracks[-1]) == 1
    assert detector.counts.tracks_ended == 0
