# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms to `/tf`: through tf2_ros where it is installed, else by the message alone."""

from __future__ import annotations

from collections.abc import Callable

from geometry_msgs.msg import TransformStamped
from rclpy.node import Node


def transform_sender(node: Node) -> Callable[[list[TransformStamped]], None]:
    """Return a function that sends transforms."""
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        from tf2_msgs.msg import TFMessage

        publisher = node.create_publisher(TFMessage, '/tf', 100)
        return lambda transforms: publisher.publish(TFMessage(transforms=transforms))
    send: Callable[[list[TransformStamped]], None] = TransformBroadcaster(node).sendTransform
    return send
