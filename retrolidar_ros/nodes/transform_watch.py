# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether others send TF frames of the same names, which then jump between their places."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from threading import Lock

from geometry_msgs.msg import TransformStamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.subscription import Subscription
from tf2_msgs.msg import TFMessage

from retrolidar_ros.nodes.conversion import to_ns

_LISTENING_S = 5.0
_PAUSES = 5  # of that length each: all of a robot's TF costs more than the detector
_KEPT = 512

Send = Callable[[list[TransformStamped]], None]


class TransformWatch:
    """Listens to TF now and then, for all senders of a process."""

    def __init__(self, node: Node) -> None:
        """Listen with `node`."""
        self._node = node
        self._senders: list[WatchedSender] = []
        self._subscription: Subscription | None = None
        self._turns = 0
        node.create_timer(_LISTENING_S, self._turn, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def watched(self, send: Send) -> WatchedSender:
        """Return a function that sends transforms, and is watched."""
        self._senders.append(WatchedSender(send))
        return self._senders[-1]

    def _turn(self) -> None:
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)
            self._subscription = None
        elif self._turns % (1 + _PAUSES) == 0 and self._senders:
            self._subscription = self._node.create_subscription(
                TFMessage, '/tf', self._on_transforms, 100
            )
        self._turns += 1

    def _on_transforms(self, message: TFMessage) -> None:
        for sender in self._senders:
            for transform in message.transforms:
                sender.hear(transform)


class WatchedSender:
    """Sends transforms, and knows which of its child frames others send, too."""

    def __init__(self, send: Send) -> None:
        """Send by `send`."""
        self._send = send
        self._lock = Lock()  # it may send in another thread than it hears
        self._sent: dict[str, deque[int]] = {}
        self._shared: dict[str, str] = {}

    def __call__(self, transforms: list[TransformStamped]) -> None:
        """Send transforms."""
        with self._lock:
            for one in transforms:
                stamps = self._sent.setdefault(one.child_frame_id, deque(maxlen=_KEPT))
                stamps.append(to_ns(one.header.stamp))
        self._send(transforms)

    def hear(self, transform: TransformStamped) -> None:
        """Take note of a transform that somebody sends."""
        child = transform.child_frame_id
        with self._lock:
            if child in self._sent and to_ns(transform.header.stamp) not in self._sent[child]:
                self._shared[child] = transform.header.frame_id

    def problem(self) -> str:
        """Say which frames others send, too; empty if they send none."""
        with self._lock:
            children = ', '.join(f'{one} (in {parent})' for one, parent in self._shared.items())
        if not children:
            return ''
        return f'another node sends the TF frames, too: {children}: set frame_prefix or child_frame'
