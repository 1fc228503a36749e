# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Drivers and detectors of several sensors in one process."""

from pathlib import Path

from harness import Sensor, check_detections, check_frames, wait_for_readings
from harness_nodes import COFFEE_IDS, running

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene


def test_many_sensors_are_read_in_one_process(tmp_path: Path) -> None:
    names, coffee = ['left', 'right'], load_scene('coffee')
    ports = [tmp_path / name for name in names]
    left, right = (Listener(f'/many/{name}') for name in names)
    with (
        running(tmp_path, '/many') as system,
        Sensor(coffee, ports[0]) as sensor,
        Sensor(load_scene('drone'), ports[1]),
    ):
        system.start('reader', ports=[str(path) for path in ports], names=names)
        wait_for_readings(left, COFFEE_IDS)
        check_frames(left, sensor, 'left_optical_frame')
        check_detections(left, coffee, 'left_optical_frame', name='left_marker_{0.id}')
        wait_for_readings(right, {2127})
        (message, _), *_ = right.markers
        assert message.header.frame_id == 'right_optical_frame'
        assert message.child_frame_id == 'right_marker_2127'
    left.close()
    right.close()
