# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms to and from TF: through tf2_ros where it is installed, else as far as that goes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.time import Time

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
    """Looks up how frames lie to each other; without tf2_ros it knows none."""

    def __init__(self, node: Node) -> None:
        """Listen to TF in the name of `node`."""
        self._buffer: Any = None
        try:
            from tf2_ros import Buffer, TransformListener
        except ImportError:
            return
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, node)

    def forget(self) -> None:
        """Forget all transforms, whose time has not come any more."""
        if self._buffer is not None:
            self._buffer.clear()

    @property
    def is_there(self) -> bool:
        """Whether tf2_ros is installed."""
        return self._buffer is not None

    def find(self, target: str, source: str, stamp: Time) -> tuple[Floats, Floats] | None:
        """Return rotation (x, y, z, w) and translation [m] from source to target frame.

        None if that is not known for this time, or not yet.
        """
        if not self._buffer.can_transform(target, source, stamp):
            return None
        transform = self._buffer.lookup_transform(target, source, stamp).transform
        turn, way = transform.rotation, transform.translation
        return np.array([turn.x, turn.y, turn.z, turn.w]), np.array([way.x, way.y, way.z])
