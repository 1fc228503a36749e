# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.bench.judging import watch
from evaluation.bench.places import (
    markers_at,
    random_pose,
    rotation,
    sees_all,
    to_sensor,
    to_world,
    view_from,
)
from evaluation.experiments import coffee
from retrolidar_ros.detector import create_detector
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.tasks.reading import SensorPose

WORLD = load_scene('coffee')
ANGLES = st.floats(-math.pi, math.pi)


@given(yaw=ANGLES, pitch=ANGLES, roll=ANGLES)
def test_to_the_sensor_and_back_is_the_identity(yaw: float, pitch: float, roll: float) -> None:
    pose = SensorPose(np.array([0.1, -0.2, 0.05]), rotation(yaw, pitch, roll))
    assert np.linalg.det(pose.rotation) == pytest.approx(1)
    seen_m = to_sensor(pose, markers_at(WORLD))
    assert to_world(pose, seen_m) == pytest.approx(markers_at(WORLD))


def test_all_are_seen_within_the_border_and_in_zones_of_their_own() -> None:
    grid = ZoneGrid()
    middles = np.append(grid.tangents, np.ones((grid.zones, 1)), axis=1)
    assert sees_all(middles, grid)
    assert not sees_all(-middles, grid)
    assert not sees_all(middles * [1.2, 1, 1], grid)
    assert not sees_all(middles[[0, 0, 1]], grid)


def test_from_its_own_place_the_sensor_sees_the_shipped_scene() -> None:
    scene = view_from(SensorPose(np.zeros(3), rotation(0, 0, 0)), WORLD, np.random.default_rng(0))
    assert markers_at(scene) == pytest.approx(markers_at(WORLD))
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
    pose = random_pose(WORLD, rng)
    scene = view_from(pose, WORLD, rng)
    recording = Simulation(replace(scene, markers=scene.markers[:2]), rng).run(4)
    time_s, errors = coffee.place_all('joint', recording, scene, pose)
    assert time_s == math.inf
    assert set(errors) == {marker.name for marker in scene.markers[:2]}
