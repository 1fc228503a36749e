# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What experiments are made of: places, recordings, times, landmarks."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.bench import landmark_parts, places
from evaluation.bench.disturbances import BLOCK_FRAMES, FAMILY, Member
from evaluation.bench.judging import BOTH, judged, watch
from evaluation.bench.landmark_parts import drone_trial, room_trial, tilt_trial
from evaluation.bench.recordings import SILENCE_BITS, record
from evaluation.bench.stresses import PLAIN, STRESSES, Stress
from evaluation.experiments import coffee, time_to_id
from evaluation.experiments.moving import across
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import Status
from retrolidar_ros.tasks.reading import SensorPose

WORLD = load_scene('coffee')
ANGLES = st.floats(-math.pi, math.pi)


@given(yaw=ANGLES, pitch=ANGLES, roll=ANGLES)
def test_to_the_sensor_and_back_is_the_identity(yaw: float, pitch: float, roll: float) -> None:
    pose = SensorPose(np.array([0.1, -0.2, 0.05]), places.rotation(yaw, pitch, roll))
    assert np.linalg.det(pose.rotation) == pytest.approx(1)
    there_m = places.markers_at(WORLD)
    assert places.to_world(pose, places.to_sensor(pose, there_m)) == pytest.approx(there_m)


def test_all_are_seen_within_the_border_and_in_zones_of_their_own() -> None:
    grid = ZoneGrid()
    middles = np.append(grid.tangents, np.ones((grid.zones, 1)), axis=1)
    markers_m = [middles, -middles, middles * [1.2, 1, 1], middles[[0, 0, 1]]]
    assert [places.sees_all(one, grid) for one in markers_m] == [True, False, False, False]


def test_from_its_own_place_the_sensor_sees_the_shipped_scene() -> None:
    scene = places.view_from(SensorPose(np.zeros(3), np.eye(3)), WORLD, np.random.default_rng(0))
    assert places.markers_at(scene) == pytest.approx(places.markers_at(WORLD))
    shown, shipped = (
        {zone: one.distance_m for one in view.surfaces for zone in one.zones or ()}
        for view in (scene, WORLD)
    )
    assert set(shown) == set(range(16))
    assert shown == pytest.approx(shipped, abs=0.02)


def test_frames_one_by_one_give_each_reading_as_soon_as_all_of_it_was_seen() -> None:
    recording = Simulation(WORLD).run(4)
    steps = watch(create_detector('joint', recording.grid), recording)
    readings = [(step, one) for step in steps for one in step.detections]
    assert {one.id for _, one in readings} == {one.id for one in WORLD.markers}
    for step, detection in readings:
        assert step.frame.stamp_ns == pytest.approx(1e9 * step.known_s + recording.stamp_ns[0])
        assert detection.start_ns < detection.stamp_ns < detection.end_ns
        assert 0 <= step.frame.stamp_ns - detection.end_ns < 0.5e9


def test_objects_that_are_not_read_are_not_placed() -> None:
    rng = np.random.default_rng(2)
    pose = places.random_pose(WORLD, rng)
    scene = places.view_from(pose, WORLD, rng)
    recording = Simulation(replace(scene, markers=scene.markers[:2]), rng).run(4)
    time_s, errors = coffee.place_all('joint', recording, scene, pose)
    assert time_s == math.inf
    assert set(errors) == {marker.name for marker in scene.markers[:2]}


@pytest.mark.parametrize('stress', STRESSES, ids=lambda stress: stress.name)
def test_a_stress_gives_the_same_possible_frames_again(stress: Stress) -> None:
    first, second = (record(stress, 150.0, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first.recording.signal, second.recording.signal)
    assert (first.recording.signal >= 0).all()
    assert (np.diff(first.recording.stamp_ns) > 0).all()
    assert len(set(first.ids.tolist())) == first.recording.grid.zones
    if first.seconds is not None:
        assert (first.seconds != first.ids).all()


def test_lone_packets_come_after_silence_and_end_before_the_recording() -> None:
    sent = record(PLAIN, 600.0, np.random.default_rng(0))
    assert sent.start_s.min() >= SILENCE_BITS * BIT_PERIOD_S
    time_s, dark = sent.recording.stamp_ns * 1e-9, sent.recording.signal < WALL_SIGNAL + 300
    ends_s = np.array([time_s[dark[:, zone]][[0, -1]] for zone in range(16)])
    assert ends_s[:, 0] == pytest.approx(sent.start_s, abs=0.022)
    assert (ends_s[:, 1] <= sent.start_s + PACKET_BITS * BIT_PERIOD_S + 0.011).all()


def test_a_hand_hides_the_middle_of_the_packet_and_a_far_wall_its_dark_bits() -> None:
    hand = record(replace(PLAIN, hand_s=0.3), 150.0, np.random.default_rng(0))
    near = hand.recording.distance < 0.3
    middles_s = [hand.recording.stamp_ns[near[:, zone]].mean() * 1e-9 for zone in range(16)]
    assert middles_s == pytest.approx(hand.start_s + hand.packet_s / 2, abs=0.02)
    assert near.sum(axis=0) * 0.021 == pytest.approx(np.full(16, 0.3), abs=0.05)
    wall = record(replace(PLAIN, far_wall=0.5), 150.0, np.random.default_rng(0))
    assert wall.recording.signal.min(axis=0) == pytest.approx(np.full(16, 77.0), abs=25)


def test_a_marker_on_its_way_is_in_one_zone_after_the_other() -> None:
    rng = np.random.default_rng(3)
    path = across(0.4, 1.0, rng)
    sent = record(PLAIN, 360.0, rng, range_m=1.0, repeated_s=8.0, path=path)
    speeds = np.abs(np.diff(path(np.arange(0, 8, 0.01))[:, 0])) / 0.01
    assert np.median(speeds) == pytest.approx(0.4)
    seen = sent.recording.signal.argmax(axis=1)[sent.recording.signal.max(axis=1) > 100]
    assert len(np.unique(seen % 4)) == 4
    assert judged(sent, BOTH['joint'], lone=False).right.shape == (1,)


@pytest.mark.parametrize('member', FAMILY, ids=lambda member: member.name)
def test_blocks_of_a_disturbance_follow_each_other(member: Member) -> None:
    duration_s = 2.5 * BLOCK_FRAMES * SENSOR.period_s
    blocks = list(member.blocks(duration_s, np.random.default_rng(3)))
    sequence = np.concatenate([block.sequence for block in blocks])
    np.testing.assert_array_equal(sequence, np.arange(len(sequence)))
    assert len(sequence) == round(duration_s / SENSOR.period_s)
    for block in blocks:
        none = block.status == Status.NO_TARGET
        assert np.isfinite(block.signal).all()
        assert (np.isnan(block.distance) == none).all()


def test_time_by_which_a_share_is_identified() -> None:
    times_s = np.array([4.0, 1.0, math.inf, 3.0, 2.0])
    assert [time_to_id.time_by_which(share, times_s) for share in (0.5, 0.9)] == [3.0, None]


def test_a_marker_is_identified_no_sooner_than_a_word_after_it_came_into_view() -> None:
    sent = time_to_id.appearing(1.0, np.random.default_rng(3))
    before = sent.recording.stamp_ns < time_to_id.VIEW_S * 1e9
    assert sent.recording.signal[before].max() < WALL_SIGNAL + 15
    times_s, wrong = time_to_id.first_ids(sent, BOTH['joint'])
    assert np.isfinite(times_s).all()
    assert times_s.min() > 19 * BIT_PERIOD_S  # seven bits of the preamble and twelve of the ID
    assert wrong <= 1  # a packet that comes into view half sent may look like another


def test_bits_that_tell_ids_apart() -> None:
    ids = np.random.default_rng(3).choice(USABLE_IDS, 3, replace=False)
    own, *others = packet(ids)
    turned = [np.roll(other, -turn) for other in others for turn in range(PACKET_BITS)]
    for start, needed in enumerate(time_to_id.needed_bits(ids)):
        differing = np.cumsum(np.roll(own, -start) != turned, axis=1).min(axis=0)
        assert needed == 1 + np.argmax(differing >= 2)


@pytest.mark.parametrize('part', landmark_parts.PARTS)
def test_what_a_part_is_switched_off_by_exists(part: str) -> None:
    for target, attribute, _ in landmark_parts.PARTS[part]:
        assert hasattr(target, attribute), f'{part}: there is no {attribute}'


def test_an_object_a_drone_and_a_robot_are_located(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landmark_parts, 'FLIGHT_S', 10.0)
    rng = np.random.default_rng(1)
    tilt_deg, errors_m = tilt_trial(math.radians(15), rng), room_trial(rng)
    assert tilt_deg is not None
    sight_deg, fixed_deg = tilt_deg
    assert sight_deg < 2
    assert fixed_deg < 20
    assert np.linalg.norm(errors_m[-1][:2]) < 0.1
    assert np.median([one.position_m for one in drone_trial(rng)[3:]]) < 0.05
