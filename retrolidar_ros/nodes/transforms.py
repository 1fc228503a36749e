# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms to and from TF, and whether other nodes send the same frames, which then jump."""

import re
import time
from collections import deque
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

_PERIOD_S, _LISTENING_S = 30.0, 5.0
_FORGOTTEN_S = 2 * _PERIOD_S  # since another node was heard last
_DEPTH = 1000
_PARENT = re.compile(r"^(\S.*): *\n +parent: '(.*)'", re.M)
_KEPT = 512  # newest stamps of a frame


class TransformFinder:
    """Looks up transforms between frames."""

    def __init__(self, node: Node) -> None:
        self._buffer = Buffer()
        self._listener = TransformListener(self._buffer, node)

    def forget(self) -> None:
        """Forget all transforms: the clock was set back."""
        self._buffer.clear()

    def parents(self) -> dict[str, str]:
        """Return the parent of each frame that has one."""
        return dict(_PARENT.findall(self._buffer.all_frames_as_yaml()))

    def find(self, target: str, source: str, stamp: Time) -> tuple[Floats, Floats] | None:
        """Return translation [m] and rotation matrix at a time; None if not known, or not yet."""
        if target == source:
            return np.zeros(3), np.eye(3)
        if not self._buffer.can_transform(target, source, stamp):
            return None
        found = self._buffer.lookup_transform(target, source, stamp).transform
        return vector_of(found.translation), matrix_of(quaternion_in(found.rotation))


class TransformSender:
    """Sends the transforms of a process, and watches whether other nodes send the same frames."""

    def __init__(self, node: Node) -> None:
        """Send in the name of `node`, once open."""
        self._node = node
        self._lock = Lock()  # sending and receiving may be in different threads
        self._broadcaster: TransformBroadcaster | None = None
        self._sent: dict[str, deque[int]] = {}  # newest stamps [ns], by child frame
        self._parents: dict[str, str] = {}
        # Parents that other nodes give to our child frames, and when they did last.
        self._shared: dict[str, tuple[str, float]] = {}
        self._began_s = 0.0
        self._listener: Node | None = None
        self._executor = SingleThreadedExecutor(context=node.context)
        self._subscription: Subscription | None = None
        self._messages = 0

    def open(self) -> None:
        """Make the publisher, if there is none yet."""
        if self._broadcaster is None:
            self._broadcaster = TransformBroadcaster(self._node)

    def send(self, transforms: list[TransformStamped]) -> None:
        """Send transforms."""
        assert self._broadcaster is not None, 'open() first'
        with self._lock:
            if not self._sent:
                self._began_s = time.monotonic()
            for transform in transforms:
                self._parents[transform.child_frame_id] = transform.header.frame_id
                stamps = self._sent.setdefault(transform.child_frame_id, deque(maxlen=_KEPT))
                stamps.append(to_ns(transform.header.stamp))
        self._broadcaster.sendTransform(transforms)

    def listen(self) -> None:
        """Take what has come on `/tf`; call it about once a second.

        It listens now and then, as all of a robot's TF costs more than a detector, and with a node
        of its own: whenever a message comes, an executor looks through all that its nodes have,
        which with many sensors takes ten milliseconds.
        """
        phase_s = (time.monotonic() - self._began_s) % _PERIOD_S
        is_due = bool(self._sent) and phase_s < _LISTENING_S
        if is_due and self._subscription is None:
            self._subscription = self._own_node().create_subscription(
                TFMessage, '/tf', self.on_transforms, _DEPTH
            )
        elif self._listener is not None and self._subscription is not None and not is_due:
            self._listener.destroy_subscription(self._subscription)
            self._subscription = None
        before = -1
        while self._subscription is not None and before < self._messages:
            before = self._messages
            self._executor.spin_once(timeout_sec=0)

    def _own_node(self) -> Node:
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

    def on_transforms(self, message: TFMessage) -> None:
        """Take transforms of any node."""
        self._messages += 1
        with self._lock:
            for transform in message.transforms:
                child, stamp_ns = transform.child_frame_id, to_ns(transform.header.stamp)
                sent = self._sent.get(child, deque[int]())
                # One older than all that are kept may be our own.
                is_known = len(sent) == _KEPT and stamp_ns < sent[0]
                if sent and not is_known and stamp_ns not in sent:
                    self._shared[child] = transform.header.frame_id, time.monotonic()

    def problem(self, parent: str) -> str:
        """Return which child frames of `parent` other nodes send, too, of late; empty if none."""
        since_s = time.monotonic() - _FORGOTTEN_S
        with self._lock:
            children = ', '.join(
                f'{child} (in {other})'
                for child, (other, heard_s) in self._shared.items()
                if self._parents[child] == parent and heard_s > since_s
            )
        if not children:
            return ''
        return f'another node sends the TF frames, too: {children}: set frame_prefix or child_frame'
