# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Clouds, images and shapes are made only while somebody subscribes to them."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from harness_nodes import endless, in_this_process, running
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.nodes import detection_topics, frame_topics
from retrolidar_ros.nodes.reader import create_nodes
from retrolidar_ros.scene.emulator import PortLink
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.wire import encode_frame

MADE = {
    'points': (PointCloud2, frame_topics, 'to_point_cloud'),
    'signal_image': (Image, frame_topics, 'to_signal_image'),
    'marker_array': (MarkerArray, detection_topics, 'marker_shapes'),
}
"""By topic: its type, and the function of a module that makes its messages."""


def test_what_nobody_hears_is_not_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = dict.fromkeys(MADE, 0)

    def count(topic: str, module: Any, name: str) -> None:
        real = getattr(module, name)

        def counted(*arguments: Any) -> Any:
            made[topic] += 1
            return real(*arguments)

        monkeypatch.setattr(module, name, counted)

    for topic, (_, module, name) in MADE.items():
        count(topic, module, name)
    packets = map(encode_frame, endless(load_scene('coffee')))
    with (
        running(tmp_path, '/lazy') as system,
        PortLink(system.port) as port,
        in_this_process(create_nodes, system, '-p', f'serial_port:={system.port}') as executor,
    ):

        def send_until(done: Callable[[], bool]) -> None:
            def sent_and_done() -> bool:
                port.write(next(packets))
                executor.spin_once(timeout_sec=0.001)
                return done()

            system.wait(sent_and_done, 'frames')

        def pass_readings() -> None:
            """Wait for frames and readings of them that were sent from now on."""
            frames, markers = len(system.frames) + 20, len(system.markers) + 3
            send_until(lambda: len(system.frames) > frames and len(system.markers) >= markers)

        pass_readings()
        assert made == dict.fromkeys(MADE, 0)
        for topic, (kind, *_) in MADE.items():
            before = dict(made)
            with system.subscribed(kind, topic) as came:
                send_until(lambda came=came: len(came) > 2)  # type: ignore[misc]
            pass_readings()  # until it is noticed that nobody subscribes any more
            assert {name for name in MADE if made[name] > before[name]} == {topic}
        before = dict(made)
        pass_readings()
        assert made == before
