# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Clouds, images and shapes are made only while somebody subscribes to them."""

from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from harness import Sensor
from harness_nodes import in_this_process, running
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.msg import MarkerDetectionArray
from retrolidar_ros.nodes import detector_topics, frame_topics
from retrolidar_ros.nodes.reader import create_nodes
from retrolidar_ros.scene.files import load_scene

MADE = {
    'points': (PointCloud2, frame_topics, 'to_point_cloud'),
    'signal_image': (Image, frame_topics, 'to_signal_image'),
    'markers_array': (MarkerDetectionArray, detector_topics, 'to_array'),
    'marker_array': (MarkerArray, detector_topics, 'marker_shapes'),
}
"""By topic: its type, and the function of a module that makes its messages."""


def test_messages_without_subscribers_are_not_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: Counter[str] = Counter()

    def count(topic: str, module: Any, name: str) -> None:
        real = getattr(module, name)

        def counted(*arguments: Any) -> Any:
            made[topic] += 1
            return real(*arguments)

        monkeypatch.setattr(module, name, counted)

    for topic, (_, module, name) in MADE.items():
        count(topic, module, name)
    with (
        running(tmp_path, '/lazy') as system,
        Sensor(load_scene('coffee'), system.port),
        in_this_process(create_nodes, system, '-p', f'serial_port:={system.port}'),
    ):

        def pass_readings() -> None:
            """Wait for frames and readings of them that came from now on."""
            frames, markers = len(system.frames) + 20, len(system.markers) + 2
            system.wait(
                lambda: len(system.frames) > frames and len(system.markers) >= markers, 'readings'
            )

        pass_readings()
        assert not made
        for topic, (kind, *_) in MADE.items():
            with system.subscribed(kind, topic) as came:
                system.wait(lambda came=came: len(came) > 2, topic)  # type: ignore[misc]
            pass_readings()  # until it is noticed that nobody subscribes any more
            assert set(made) == {topic}
            made.clear()
        pass_readings()
        assert not made
