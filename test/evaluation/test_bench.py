# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What experiments are made of: places, recordings, and when IDs are known."""

import math
from dataclasses import replace

import numpy as np
import pytest

from evaluation.bench.disturbances import BLOCK_FRAMES, FAMILY, Member
from evaluation.bench.judging import watch
from evaluation.bench.places import random_pose, view_from
from evaluation.bench.recordings import SILENCE_BITS, record
from evaluation.bench.stresses import PLAIN, STRESSES, Stress
from evaluation.experiments import coffee
from evaluation.experiments.time_to_id import needed_bits, time_by_which
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.model import Status

WORLD = load_scene('coffee')


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
    pose = random_pose(WORLD, rng)
    scene = view_from(pose, WORLD, rng)
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
    time_s = sent.recording.stamp_ns * 1e-9
    dark = sent.recording.signal < WALL_SIGNAL + 300
    for zone, start_s in enumerate(sent.start_s):
        first_s, last_s = time_s[dark[:, zone]][[0, -1]]
        assert first_s == pytest.approx(start_s, abs=0.022)
        assert last_s <= start_s + PACKET_BITS * BIT_PERIOD_S + 0.011


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
    assert (time_by_which(0.5, times_s), time_by_which(0.9, times_s)) == (3.0, None)


def test_bits_that_tell_ids_apart() -> None:
    ids = np.random.default_rng(3).choice(USABLE_IDS, 3, replace=False)
    needed = needed_bits(ids)
    own, *others = (packet(np.array([one]))[0] for one in ids)
    for start in range(PACKET_BITS):
        differing = [
            np.cumsum(np.roll(own, -start) != np.roll(other, -turn))
            for other in others
            for turn in range(PACKET_BITS)
        ]
        excluded = np.min(differing, axis=0) >= 2
        assert needed[start] == 1 + np.argmax(excluded)
