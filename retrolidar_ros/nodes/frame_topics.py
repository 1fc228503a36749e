# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The topics of a frame: the frame itself, and standard messages for their subscribers."""

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
    to_point_cloud,
    to_signal_image,
)
from retrolidar_ros.nodes.qos import FRAME_QOS, STREAM, publisher
from retrolidar_ros.sensor.frame import Frame

_COUNT_PERIOD_FRAMES = 5  # subscribers are counted once in so many frames: that is slow


class FrameTopics:
    """The topics `frames`, `points`, `signal_image`, and those of a depth camera (REP 118)."""

    def __init__(self, node: Node, frame_id: str) -> None:
        """Make the publishers; the optical frame is `frame_id`."""
        self._frame_id = frame_id
        self._subscribed: list[tuple[Any, Callable[..., Any]]] = []
        self._topics: list[tuple[Any, Callable[..., Any]]] = [
            (publisher(node, FrameMsg, 'frames', FRAME_QOS), to_frame_msg),
            (publisher(node, PointCloud2, 'points', STREAM), to_point_cloud),
            (publisher(node, Image, 'signal_image', STREAM), to_signal_image),
            (publisher(node, Image, 'depth/image_raw', STREAM), to_depth_image),
            (publisher(node, CameraInfo, 'depth/camera_info', STREAM), to_camera_info),
        ]

    def publish(self, frame: Frame) -> None:
        """Publish a frame, stamped in ROS time, on all topics with subscribers."""
        if frame.sequence % _COUNT_PERIOD_FRAMES == 0:
            self._subscribed = [
                topic for topic in self._topics if topic[0].get_subscription_count()
            ]
        for topic, convert in self._subscribed:
            topic.publish(convert(frame, self._frame_id))
