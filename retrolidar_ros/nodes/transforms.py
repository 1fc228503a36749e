# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms to and from TF, and whether other nodes send the same frames, which then jump."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from threading import Lock

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.time import Time
from tf2_msgs.msg import TFMessage
from tf2_ros import Buffer, TransformBroadcaster, TransformListener

from retrolidar_ros.nodes.conversion import quaternion_in, to_ns, vector_of
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of

_PERIOD_S = 0.9
_LISTENING, _PAUSE = 5, 25  # periods each: all of a robot's TF costs more than the detector
_DEPTH = 1000
_KEPT = 512
Send = Callable[[list[TransformStamped]], None]


def transform_sender(node: Node) -> Send:
    """Return a function that sends transforms to `/tf`."""
    send: Send = TransformBroadcaster(node).sendTransform
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


class TransformWatch:
    """Subscribes to TF from time to time, for all senders of a process."""

    def __init__(self, node: Node) -> None:
        """Listen for the process of `node`."""
        self._node = node
        self._senders: list[WatchedSender] = []
        self._listener: Node | None = None
        self._executor = SingleThreadedExecutor(context=node.context)
        self._subscription: Subscription | None = None
        self._periods = self._messages = 0
        self._next_s = 0.0

    def watched(self, send: Send) -> WatchedSender:
        """Return a function that sends transforms, and is watched."""
        self._senders.append(WatchedSender(send))
        return self._senders[-1]

    def listen(self) -> None:
        """Begin or end listening, or process what has come; call it about once a second.

        It has no timer, for an executor looks through all that its nodes have whenever one is due,
        which in a process of many sensors takes ten milliseconds.
        """
        if (now_s := time.monotonic()) < self._next_s:
            return
        self._next_s = now_s + _PERIOD_S
        phase = self._periods % (_LISTENING + _PAUSE)
        self._periods += bool(self._senders)
        if phase == _LISTENING and self._listener is not None and self._subscription is not None:
            self._listener.destroy_subscription(self._subscription)
            self._subscription = None
        elif phase == 0 and self._senders:
            self._subscription = self._own_node().create_subscription(
                TFMessage, '/tf', self._on_transforms, _DEPTH
            )
        elif self._subscription is not None:
            before = -1
            while before < self._messages:
                before = self._messages
                self._executor.spin_once(timeout_sec=0)

    def _own_node(self) -> Node:
        """Return a hidden node for the subscription, which the executor of others never sees."""
        if self._listener is None:
            name, space = f'_{self._node.get_name()}_tf', self._node.get_namespace()
            self._listener = Node(
                name,
                context=self._node.context,
                cli_args=['--ros-args', '-r', f'__node:={name}', '-r', f'__ns:={space}'],
                enable_rosout=False,
                start_parameter_services=False,
            )
            self._executor.add_node(self._listener)
        return self._listener

    def _on_transforms(self, message: TFMessage) -> None:
        self._messages += 1
        for sender in self._senders:
            for transform in message.transforms:
                sender.on_transform(transform)


class WatchedSender:
    """Sends transforms, and notes which of its child frames other nodes send, too."""

    def __init__(self, send: Send) -> None:
        """Send by `send`."""
        self._send = send
        self._lock = Lock()  # sending and receiving may be in different threads
        self._sent: dict[str, deque[int]] = {}
        self._shared: dict[str, str] = {}

    def __call__(self, transforms: list[TransformStamped]) -> None:
        """Send transforms."""
        with self._lock:
            for one in transforms:
                stamps = self._sent.setdefault(one.child_frame_id, deque(maxlen=_KEPT))
                stamps.append(to_ns(one.header.stamp))
        self._send(transforms)

    def on_transform(self, transform: TransformStamped) -> None:
        """Take a transform from any node."""
        child = transform.child_frame_id
        with self._lock:
            if child in self._sent and to_ns(transform.header.stamp) not in self._sent[child]:
                self._shared[child] = transform.header.frame_id

    def problem(self) -> str:
        """Return which frames other nodes send, too; empty if none."""
        with self._lock:
            children = ', '.join(f'{one} (in {parent})' for one, parent in self._shared.items())
        if not children:
            return ''
        return f'another node sends the TF frames, too: {children}: set frame_prefix or child_frame'
