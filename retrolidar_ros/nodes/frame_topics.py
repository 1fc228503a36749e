# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a driver publishes of a frame: the frame itself, and standard messages for who listens."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import (
    to_camera_info,
    to_depth_image,
    to_frame_msg,
    to_header,
    to_point_cloud,
    to_signal_image,
)
from retrolidar_ros.nodes.qos import STREAM, publisher
from retrolidar_ros.sensor.frame import Frame


class FrameTopics:
    """The topics `frames`, `points`, `signal_image`, and those of a depth camera (REP 118)."""

    def __init__(self, node: Node, frame_id: str) -> None:
        """Make the publishers; the optical frame is `frame_id`."""
        self._frame_id = frame_id
        self._frames = publisher(node, FrameMsg, 'frames', STREAM)
        standard: dict[str, tuple[Any, Callable[..., Any]]] = {
            'points': (PointCloud2, to_point_cloud),
            'signal_image': (Image, to_signal_image),
            'depth/image_raw': (Image, to_depth_image),
            'depth/camera_info': (CameraInfo, to_camera_info),
        }
        self._standard = [
            (publisher(node, kind, topic, STREAM), convert)
            for topic, (kind, convert) in standard.items()
        ]

    def publish(self, frame: Frame) -> None:
        """Publish a frame, stamped in ROS time, on all topics with subscribers."""
        if self._frames.get_subscription_count():
            self._frames.publish(to_frame_msg(frame, self._frame_id))
        for topic, convert in self._standard:
            if topic.get_subscription_count():
                topic.publish(convert(frame, to_header(frame.stamp_ns, self._frame_id)))
