# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Clouds, images and shapes are made only while somebody subscribes to them."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from harness_nodes import FRAME_ID, System, endless, in_this_process, running
from sensor_msgs.msg import Image, PointCloud2
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes import detection_topics, frame_topics
from retrolidar_ros.nodes.conversion import to_frame_msg
from retrolidar_ros.nodes.detector import DetectorNode
from retrolidar_ros.nodes.driver import DriverNode
from retrolidar_ros.scene.emulator import PortLink
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.wire import encode_frame


@pytest.fixture
def system(tmp_path: Path) -> Iterator[System]:
    with running(tmp_path, '/lazy') as system:
        yield system


def counting(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> list[None]:
    """Replace a function of a module by one that counts its calls."""
    calls: list[None] = []
    real = getattr(module, name)

    def counted(*arguments: Any) -> Any:
        calls.append(None)
        return real(*arguments)

    monkeypatch.setattr(module, name, counted)
    return calls


def test_points_and_image(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    points = counting(monkeypatch, frame_topics, 'to_point_cloud')
    images = counting(monkeypatch, frame_topics, 'to_signal_image')
    packets = map(encode_frame, endless(load_scene('coffee')))

    def send_until(done: Callable[[], bool]) -> None:
        def sent_and_done() -> bool:
            port.write(next(packets))
            return done()

        system.wait(sent_and_done, 'frames')

    def pass_frames() -> None:
        """Wait for frames that were sent from now on."""
        seen = len(system.listener.frames) + 20
        send_until(lambda: len(system.listener.frames) > seen)

    with (
        PortLink(system.port) as port,
        in_this_process(lambda: [DriverNode()], system, '-p', f'serial_port:={system.port}'),
    ):
        pass_frames()
        assert (len(points), len(images)) == (0, 0)
        with system.subscribed(PointCloud2, 'points') as clouds:
            send_until(lambda: len(clouds) > 5)
        assert len(points) > 5
        assert not images
        with system.subscribed(Image, 'signal_image') as pictures:
            send_until(lambda: len(pictures) > 5)
        pass_frames()
        made = len(points), len(images)
        pass_frames()
        assert (len(points), len(images)) == made


def test_shapes(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = counting(monkeypatch, detection_topics, 'marker_shapes')
    frames = endless(load_scene('coffee'))
    publisher = system.node.create_publisher(FrameMsg, 'frames', 10)
    with in_this_process(lambda: [DetectorNode()], system) as executor:

        def feed_until(done: Callable[[], bool]) -> None:
            def fed_and_done() -> bool:
                publisher.publish(to_frame_msg(next(frames), FRAME_ID))
                executor.spin_once(timeout_sec=0.005)
                return done()

            system.wait(fed_and_done, 'detections')

        def pass_readings() -> None:
            seen = len(system.listener.markers) + 3
            feed_until(lambda: len(system.listener.markers) >= seen)

        system.wait(lambda: publisher.get_subscription_count() > 1, 'the detector')
        pass_readings()
        assert not drawn
        with system.subscribed(MarkerArray, 'marker_array') as arrays:
            feed_until(lambda: bool(arrays))
        assert drawn
        pass_readings()
        made = len(drawn)
        pass_readings()
        assert len(drawn) == made
