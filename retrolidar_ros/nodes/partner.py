# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Word of a detector that has none to say: one that was killed, or hangs."""

from __future__ import annotations

import time

from rclpy.node import Node
from std_msgs.msg import Header

from retrolidar_ros.nodes.diagnostics import STALE, Health

_SILENCE_S = 0.8
_NAME = 'detector'


class DetectorWatch:
    """Hears the heartbeat of the detector that takes a driver's frames."""

    def __init__(self, node: Node) -> None:
        """Listen in the name of a driver."""
        self.name = f'{node.get_namespace().rstrip("/")}/{_NAME}: markers'
        """Of the detector's health."""
        self._beat_s: float | None = None
        self._frame_s = 0.0
        node.create_subscription(Header, f'{_NAME}/heartbeat', self._beat, 10)

    def _beat(self, _: Header) -> None:
        self._beat_s = self._frame_s = time.monotonic()

    def sent(self) -> None:
        """Take note that there was a frame to be judged."""
        self._frame_s = time.monotonic()

    def examine(self) -> Health | None:
        """Say that the detector is silent, if it once was not and there are frames to judge."""
        if self._beat_s is None:
            return None
        silence_s = self._frame_s - self._beat_s
        if silence_s < _SILENCE_S:
            return None
        text = f'no frame has been judged for {silence_s:.1f} s: the node has ended, or hangs'
        return Health(STALE, text, {})
