# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `landmarks`, started by itself: what test/launch asserts of its launch file."""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from harness_landmarks import EDGE_M, GROUND, Hand, check_drone, check_landmarks, squared
from harness_nodes import running
from harness_observer import LATCHED, RELIABLE
from tf2_msgs.msg import TFMessage

from retrolidar_ros.nodes.conversion import to_header, to_pose, to_transform, vector_of
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.reading import Errors
from retrolidar_ros.tasks.state import Prior, State
from retrolidar_ros.tasks.survey import survey_content


def static_transform(child: str, parent: str, place_m: tuple[float, float]) -> TransformStamped:
    pose = to_pose(np.array([*place_m, 0.0]), np.array([0.0, 0.0, 0.0, 1.0]))
    return to_transform(to_header(0, parent), child, pose)


def test_landmarks_are_found_moved_saved_and_forgotten(tmp_path: Path) -> None:
    saved = tmp_path / 'room.yaml'
    with running(tmp_path, '/landmarks_alone') as system:
        system.start('landmarks', save_file=saved)
        check_landmarks(system, saved)


def test_a_robot_is_localised_among_the_landmarks_of_a_file(tmp_path: Path) -> None:
    places = {5: [-0.3, -0.3, 1.5], 6: [0.3, -0.25, 1.2], 8: [0.25, 0.3, 1.4], 9: [-0.3, 0.3, 1.1]}
    estimates = []
    for identity, at in places.items():
        prior = Prior(State(np.array(at), np.eye(3), np.zeros(3)), 1e-6 * np.eye(6))
        estimate = Landmark(f'marker_{identity}', {}, Errors(), prior).estimate()
        assert estimate is not None
        estimates.append(estimate)
    known = tmp_path / 'room.yaml'
    known.write_text(yaml.safe_dump(survey_content('map', estimates)))
    robot_m = np.array([0.02, -0.03, 0.0])
    before = known.read_bytes()
    with running(tmp_path, '/landmarks_robot') as system:
        system.start('landmarks', load_file=known, save_file=known, localize='true')
        poses = system.collect(PoseWithCovarianceStamped, 'landmarks/pose', RELIABLE)
        hand = Hand(system)
        while len(poses) < 6:
            for identity, at in places.items():
                # The hand's own frame is the fixed one here, and the robot is off its origin.
                there_m = np.array(at) - robot_m
                hand.read(f'marker_{identity}', identity, there_m, np.zeros(3))
        pose = poses[-1]
        assert pose.header.frame_id == 'map'
        assert squared(pose, robot_m) < 16.27
        assert np.linalg.norm(vector_of(pose.pose.pose.position) - robot_m) < 0.05
        answer = system.services.trigger('landmarks/save')
        assert not answer.success
        assert 'while localising no map is made' in answer.message
    assert known.read_bytes() == before


def test_three_sensors_on_the_ground_locate_a_drone(tmp_path: Path) -> None:
    known = shared_file('config/markers.yaml')
    (drone,) = load_scene('drone').markers
    with running(tmp_path, '/landmarks_drone') as system:
        system.start('landmarks', fixed_frame=GROUND, acceleration=0.04, marker_file=known)
        ports = [str(tmp_path / f'port{index}') for index in range(3)]
        topic = ('-r', f'markers:={system.namespace}/markers')
        system.start('reader', *topic, ports=ports, marker_file=known)
        start_s = time.monotonic() + 3.0
        zero_ns = time.time_ns() - time.monotonic_ns() + round(start_s * 1e9)
        transforms = []
        emulate = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate', 'drone']
        for index, port in enumerate(ports):
            angle = 2 * math.pi * index / 3
            x, y = (EDGE_M / math.sqrt(3) * f(angle) for f in (math.cos, math.sin))
            place = ['--at', str(x), str(y), '0', '--start', str(start_s), '--seed', str(index)]
            system.processes.start(f'emulator{index}', [*emulate, '--port-link', port, *place])
            transforms.append(static_transform(f'sensor{index}_optical_frame', GROUND, (x, y)))
        static = system.node.create_publisher(TFMessage, '/tf_static', LATCHED)
        static.publish(TFMessage(transforms=transforms))

        def at(stamp_ns: int) -> Floats:
            place: Floats = position_at(drone, np.array([(stamp_ns - zero_ns) * 1e-9]))[0]
            return place

        check_drone(system, at)
