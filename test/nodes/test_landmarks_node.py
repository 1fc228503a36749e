# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `landmarks`, started by itself: what test/launch asserts of its launch file."""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from harness_landmarks import EDGE_M, GROUND, Hand, check_drone, check_landmarks
from harness_use_cases import RELIABLE, Collected
from tf2_msgs.msg import TFMessage

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.nodes.conversion import to_time
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.qos import LATCHED
from retrolidar_ros.nodes.transform_buffer import TransformBuffer
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.reading import Errors
from retrolidar_ros.tasks.state import Prior, State
from retrolidar_ros.tasks.survey import survey_content


def start(processes: ProcessGroup, namespace: str, *parameters: str) -> None:
    common = ['--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))]
    given = [part for one in parameters for part in ('-p', one)]
    node = executable('landmarks')
    processes.start('landmarks', [node, *common, '-r', f'__ns:={namespace}', *given])


def test_landmarks_are_found_moved_saved_and_forgotten(tmp_path: Path) -> None:
    listener = Listener('/landmarks_alone')
    try:
        with ProcessGroup(tmp_path) as processes:
            saved = tmp_path / 'room.yaml'
            start(processes, '/landmarks_alone', f'save_file:={saved}')
            check_landmarks(listener, '/landmarks_alone', saved)
            assert processes.stop('landmarks') == 0
            assert 'Traceback' not in processes.log('landmarks').read_text()
    finally:
        listener.close()


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
    listener = Listener('/landmarks_robot')
    try:
        with ProcessGroup(tmp_path) as processes:
            start(processes, '/landmarks_robot', f'load_file:={known}', 'localize:=true')
            poses = Collected(
                listener, PoseWithCovarianceStamped, '/landmarks_robot/landmarks/pose', RELIABLE
            )
            hand = Hand(listener, '/landmarks_robot')
            hand.wait_for_subscribers()
            while len(poses.messages) < 6:
                for identity, at in places.items():
                    # The hand's own frame is the fixed one here, and the robot is off its origin.
                    there_m = np.array(at) - robot_m
                    hand.read(f'marker_{identity}', identity, there_m, np.zeros(3))
            pose = poses.messages[-1]
            assert pose.header.frame_id == 'map'
            place = pose.pose.pose.position
            off = np.array([place.x, place.y, place.z]) - robot_m
            covariance = np.array(pose.pose.covariance).reshape(6, 6)
            assert off @ np.linalg.solve(covariance[:3, :3], off) < 16.27
            assert np.linalg.norm(off) < 0.05
            assert processes.stop('landmarks') == 0
    finally:
        listener.close()


def test_three_sensors_on_the_ground_tell_where_a_drone_is(tmp_path: Path) -> None:
    namespace = '/landmarks_drone'
    marker_file = f'marker_file:={shared_file("config/markers.yaml")}'
    (drone,) = load_scene('drone').markers
    listener = Listener(namespace)
    try:
        with ProcessGroup(tmp_path) as processes:
            start(
                processes,
                namespace,
                f'fixed_frame:={GROUND}',
                'acceleration:=0.04',
                marker_file,
            )
            ports = [str(tmp_path / f'port{index}') for index in range(3)]
            common = ['--params-file', str(shared_file('config/retrolidar.yaml'))]
            common += ['-r', f'__ns:={namespace}', '-r', f'markers:={namespace}/markers']
            given = ['-p', f'ports:=[{",".join(ports)}]', '-p', marker_file]
            processes.start('reader', [executable('reader'), '--ros-args', *common, *given])
            start_s = time.monotonic() + 3.0
            zero_ns = time.time_ns() - time.monotonic_ns() + round(start_s * 1e9)
            transforms = []
            emulate = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate', 'drone']
            for index, port in enumerate(ports):
                angle = 2 * math.pi * index / 3
                x, y = (EDGE_M / math.sqrt(3) * f(angle) for f in (math.cos, math.sin))
                place = ['--at', str(x), str(y), '0', '--start', str(start_s), '--seed', str(index)]
                processes.start(f'emulator{index}', [*emulate, '--port-link', port, *place])
                one = transform(f'sensor{index}_optical_frame', GROUND, x, 0)
                one.transform.translation.y = y
                transforms.append(one)
            static = listener.node.create_publisher(TFMessage, '/tf_static', LATCHED)
            static.publish(TFMessage(transforms=transforms))

            def at(stamp_ns: int) -> Floats:
                place: Floats = position_at(drone, np.array([(stamp_ns - zero_ns) * 1e-9]))[0]
                return place

            check_drone(listener, namespace, at)
            processes.check()
    finally:
        listener.close()


def transform(
    child: str, parent: str, x: float, stamp_ns: int, yaw: float = 0.0
) -> TransformStamped:
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id, message.header.stamp = parent, to_time(stamp_ns)
    message.transform.translation.x = x
    message.transform.rotation.z, message.transform.rotation.w = (
        math.sin(yaw / 2),
        math.cos(yaw / 2),
    )
    return message


def test_the_buffer_goes_between_frames_and_times() -> None:
    buffer = TransformBuffer()
    buffer.take(
        [transform('hand', 'base', 1.0, 1_000), transform('hand', 'base', 2.0, 3_000, 1.0)],
        static=False,
    )
    buffer.take([transform('eye', 'hand', 0.5, 0)], static=True)
    found = buffer.find('base', 'eye', 2_000)
    assert found is not None
    assert found[1] == pytest.approx([1.5 + 0.5 * math.cos(0.5), 0.5 * math.sin(0.5), 0])
    back = buffer.find('eye', 'base', 1_000)
    assert back is not None
    assert back[1] == pytest.approx([-1.5, 0, 0])
    assert buffer.find('base', 'eye', 3_001) is None  # not yet
    assert buffer.find('base', 'eye', 999) is None
    assert buffer.find('base', 'nowhere', 2_000) is None
    assert buffer.has('eye')
    assert not buffer.has('base')
    buffer.clear()
    assert buffer.find('hand', 'eye', 5) is not None
    assert buffer.find('base', 'eye', 2_000) is None
