# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms to and from TF."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.time import Time
from tf2_ros import Buffer, TransformBroadcaster, TransformListener

from retrolidar_ros.nodes.conversion import quaternion_in, vector_of
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of


def transform_sender(node: Node) -> Callable[[list[TransformStamped]], None]:
    """Return a function that sends transforms to `/tf`."""
    send: Callable[[list[TransformStamped]], None] = TransformBroadcaster(node).sendTransform
    return send


class TransformFinder:
    """Looks up transforms between frames."""

    def __init__(self, node: Node) -> None:
        """Subscribe to TF with `node`."""
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, node)

    def forget(self) -> None:
        """Forget all transforms: the clock was set back."""
        self._buffer.clear()

    def knows(self, frame: str) -> bool:
        """Return whether a frame has a parent."""
        # A line for each frame; its parent, times and rates follow on lines of their own.
        lines = self._buffer.all_frames_as_yaml().splitlines()
        return any(line.rstrip() == f'{frame}:' for line in lines)

    def find(self, target: str, source: str, stamp: Time) -> tuple[Floats, Floats] | None:
        """Return translation [m] and rotation matrix from source to target frame.

        None if that is not known for this time, or not yet.
        """
        if target == source:
            return np.zeros(3), np.eye(3)
        if not self._buffer.can_transform(target, source, stamp):
            return None
        found = self._buffer.lookup_transform(target, source, stamp).transform
        return vector_of(found.translation), matrix_of(quaternion_in(found.rotation))
