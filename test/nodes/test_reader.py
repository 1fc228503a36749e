# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Driver and detector in one process: poses by names, and several sensors."""

from pathlib import Path

from geometry_msgs.msg import PoseStamped
from harness import Sensor, wait_for_readings
from harness_nodes import COFFEE_IDS, running

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.resources import shared_file


def test_poses_of_known_markers_come_by_their_names(tmp_path: Path) -> None:
    with running(tmp_path, '/poses') as system, Sensor(load_scene('coffee'), system.port):
        known = shared_file('config/markers.yaml')
        system.start('reader', serial_port=system.port, marker_file=known)
        with system.subscribed(PoseStamped, 'poses/mug') as poses:

            def is_heard() -> bool:
                messages = [message for message, _ in system.markers]
                mugs = [one.pose.pose for one in messages if one.child_frame_id == 'mug']
                return bool(poses) and poses[-1].pose in mugs

            system.wait(is_heard, 'poses')


def test_many_sensors_are_read_in_one_process(tmp_path: Path) -> None:
    names = ['left', 'right']
    ports = {name: tmp_path / name for name in names}
    listeners = {name: Listener(f'/many/{name}') for name in names}
    with (
        running(tmp_path, '/many') as system,
        Sensor(load_scene('coffee'), ports['left']),
        Sensor(load_scene('drone'), ports['right']),
    ):
        system.start('reader', ports=[str(path) for path in ports.values()], names=names)
        for name, expected in (('left', COFFEE_IDS), ('right', {2127})):
            wait_for_readings(listeners[name], expected)
            (message, _), *_ = listeners[name].markers
            assert message.header.frame_id == f'{name}_optical_frame'
            assert message.child_frame_id == f'{name}_marker_{message.id}'
            listeners[name].close()
