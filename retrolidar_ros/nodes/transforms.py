# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms to and from TF: through tf2_ros where it is installed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from retrolidar_ros.nodes.transform_buffer import TransformBuffer
from retrolidar_ros.sensor.frame import Floats


def transform_sender(node: Node) -> Callable[[list[TransformStamped]], None]:
    """Return a function that sends transforms to `/tf`."""
    try:
        from tf2_ros import TransformBroadcaster
    except ImportError:
        from tf2_msgs.msg import TFMessage

        publisher = node.create_publisher(TFMessage, '/tf', 100)
        return lambda transforms: publisher.publish(TFMessage(transforms=transforms))
    send: Callable[[list[TransformStamped]], None] = TransformBroadcaster(node).sendTransform
    return send


class TransformFinder:
    """Looks up transforms between frames."""

    def __init__(self, node: Node) -> None:
        """Subscribe to TF with `node`."""
        self._own: TransformBuffer | None = None
        try:
            from tf2_ros import Buffer, TransformListener
        except ImportError:
            self._own = TransformBuffer()
            self._listen(node, self._own)
            return
        self._buffer: Any = Buffer()
        self._listener = TransformListener(self._buffer, node)

    @staticmethod
    def _listen(node: Node, buffer: TransformBuffer) -> None:
        from tf2_msgs.msg import TFMessage

        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)

        def take(message: TFMessage) -> None:
            buffer.take(message.transforms, static=False)

        def take_static(message: TFMessage) -> None:
            buffer.take(message.transforms, static=True)

        node.create_subscription(TFMessage, '/tf', take, QoSProfile(depth=100))
        node.create_subscription(TFMessage, '/tf_static', take_static, latched)

    def forget(self) -> None:
        """Forget all transforms: the clock was set back."""
        (self._own or self._buffer).clear()

    def knows(self, frame: str) -> bool:
        """Return whether a frame has a parent."""
        if self._own is not None:
            return self._own.has(frame)
        return f'{frame}:' in self._buffer.all_frames_as_yaml()

    def find(self, target: str, source: str, stamp: Time) -> tuple[Floats, Floats] | None:
        """Return rotation (x, y, z, w) and translation [m] from source to target frame.

        None if that is not known for this time, or not yet.
        """
        if self._own is not None:
            return self._own.find(target, source, stamp.nanoseconds)
        if not self._buffer.can_transform(target, source, stamp):
            return None
        transform = self._buffer.lookup_transform(target, source, stamp).transform
        turn, way = transform.rotation, transform.translation
        return np.array([turn.x, turn.y, turn.z, turn.w]), np.array([way.x, way.y, way.z])
