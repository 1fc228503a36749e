# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What experiments are made of: places, recordings, times, landmarks, visual markers."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from evaluation.bench import landmark_parts, landmark_trials
from evaluation.bench.disturbances import BLOCK_FRAMES, FAMILY, Member
from evaluation.bench.judging import watch
from evaluation.bench.landmark_trials import drone_trial, room_trial, tilt_trial
from evaluation.bench.places import random_pose, view_from
from evaluation.bench.recordings import record
from evaluation.bench.stresses import STRESSES, Stress
from evaluation.experiments import coffee
from evaluation.experiments.time_to_id import time_by_which
from evaluation.peers.camera import Background
from evaluation.peers.visual_markers import AprilTagReader, View, find_readers, read_pictures
from retrolidar_ros.detector import create_detector
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.reference import SENSOR
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


@pytest.mark.parametrize('part', landmark_parts.PARTS)
def test_what_a_part_is_switched_off_by_exists(part: str) -> None:
    for target, attribute, _ in landmark_parts.PARTS[part]:
        assert hasattr(target, attribute), f'{part}: there is no {attribute}'


def test_an_object_a_drone_and_a_robot_are_located(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(landmark_trials, 'FLIGHT_S', 10.0)
    rng = np.random.default_rng(1)
    tilt_deg, off_m = tilt_trial(math.radians(15), rng), room_trial(rng)
    assert tilt_deg is not None
    assert tilt_deg[0] < 2
    assert off_m is not None
    assert off_m < 0.1
    assert np.median([one.position_m for one in drone_trial(rng)[3:]]) < 0.05


class Liar(AprilTagReader):
    """Reads another ID than is there."""

    def read(self, picture: Any, centre_px: Any, size_m: float) -> Any:
        (seen,) = super().read(picture, centre_px, size_m)
        return [seen._replace(id=seen.id + 1)]


def test_right_and_wrong_ids_of_visual_markers_are_counted() -> None:
    rng = np.random.default_rng(3)
    true, liar = find_readers()[0], Liar('liar', 2.0)
    results = read_pictures([*true, liar], Background(rng), 4, rng, View(0.6))
    for reader in true:
        found = results[reader.name]
        assert (found['right']['hits'], found['wrong']['hits']) == (4, 0)
        assert found['error_mm'] is not None
        assert found['error_mm']['largest'] < 6
    found = results[liar.name]
    assert (found['right']['hits'], found['wrong']['hits']) == (0, 4)
    assert found['error_mm'] is None
