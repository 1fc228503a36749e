# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A driver at a board that runs ST's example, and drivers and detectors in one process."""

from pathlib import Path

import pytest
from harness import Sensor, check_detections, check_frames, wait_for_readings
from harness_nodes import COFFEE_IDS, running
from harness_observer import values_of
from st_board import Board, Zone

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene


def test_text_is_published_as_frames(tmp_path: Path) -> None:
    zones: list[Zone | None] = [None] * 16
    zones[3] = Zone(700, signal_kcps=250, ambient_kcps=4)  # at the scene's top left
    with (
        Board(zones) as board,
        running(tmp_path, '/kit') as system,
        system.subscribed(FrameMsg, 'frames') as messages,
    ):
        system.start('driver', serial_port=board.path, protocol='st_example')
        with board.printing():
            system.wait(lambda: sum(one.signal[0] > 0 for one in messages) > 30, 'frames')
            values = values_of(system.next_status('driver: frames'))
        reset = system.services.trigger('driver/reset')
        assert (reset.success, reset.message) == (False, 'this protocol has no commands')
        assert board.keys == b's'
    lit = [message.signal[0] > 0 for message in messages]
    assert lit == sorted(lit)  # once switched on, it stays on
    for message in messages:
        assert (message.rows, message.columns) == (4, 4)
        assert message.distance[0] == pytest.approx(0.7)
        assert list(message.status) == [5] + [255] * 15
    assert (messages[-1].signal[0], messages[-1].ambient[0]) == (250, 4)
    stamps = [to_ns(message.header.stamp) for message in messages]
    assert stamps == sorted(set(stamps))
    assert int(values['frames']) >= 30
    assert values['clock restarts'] == '0'


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
