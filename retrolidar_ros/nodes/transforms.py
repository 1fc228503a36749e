# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms to and from TF: through tf2_ros, or a part of it where that is not installed."""

from __future__ import annotations

from bisect import bisect, insort
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time

from retrolidar_ros.nodes.conversion import quaternion_in, to_ns, vector_of
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of

_KEPT_NS = 10_000_000_000
_MOST_FRAMES = 100  # from a frame to its root: a ring of frames has none


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
        self._buffer: Any
        try:
            from tf2_ros import Buffer, TransformListener
        except ImportError:
            self._buffer = TransformBuffer()
            self._buffer.listen(node)
        else:
            self._buffer = Buffer()
            self._listener = TransformListener(self._buffer, node)

    def forget(self) -> None:
        """Forget all transforms: the clock was set back."""
        self._buffer.clear()

    def knows(self, frame: str) -> bool:
        """Return whether a frame has a parent."""
        if isinstance(self._buffer, TransformBuffer):
            return self._buffer.has(frame)
        # A line for each frame; its parent, times and rates follow on lines of their own.
        lines = self._buffer.all_frames_as_yaml().splitlines()
        return any(line.rstrip() == f'{frame}:' for line in lines)

    def find(self, target: str, source: str, stamp: Time) -> tuple[Floats, Floats] | None:
        """Return translation [m] and rotation matrix from source to target frame.

        None if that is not known for this time, or not yet.
        """
        if target == source:
            return np.zeros(3), np.eye(3)
        if isinstance(self._buffer, TransformBuffer):
            return self._buffer.find(target, source, stamp.nanoseconds)
        if not self._buffer.can_transform(target, source, stamp):
            return None
        found = self._buffer.lookup_transform(target, source, stamp).transform
        return vector_of(found.translation), matrix_of(quaternion_in(found.rotation))


class _Link(NamedTuple):
    stamp_ns: int
    parent: str
    translation_m: Floats
    turn: Floats
    """A quaternion."""


class TransformBuffer:
    """Keeps the transforms of the last ten seconds."""

    def __init__(self) -> None:
        """Begin without any."""
        self._links: dict[str, list[_Link]] = {}
        self._fixed: set[str] = set()

    def listen(self, node: Node) -> None:
        """Take what is sent to TF."""
        from tf2_msgs.msg import TFMessage

        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for topic, qos in (('/tf', QoSProfile(depth=100)), ('/tf_static', latched)):

            def take(message: TFMessage, static: bool = topic == '/tf_static') -> None:
                self.take(message.transforms, static=static)

            node.create_subscription(TFMessage, topic, take, qos)

    def clear(self) -> None:
        """Forget all but static transforms."""
        self._links = {child: self._links[child] for child in self._fixed}

    def take(self, transforms: Iterable[TransformStamped], *, static: bool) -> None:
        """Take transforms."""
        for one in transforms:
            link = _Link(
                to_ns(one.header.stamp),
                one.header.frame_id,
                vector_of(one.transform.translation),
                quaternion_in(one.transform.rotation),
            )
            if static:
                self._fixed.add(one.child_frame_id)
                self._links[one.child_frame_id] = [link]
            elif one.child_frame_id not in self._fixed:
                links = self._links.setdefault(one.child_frame_id, [])
                insort(links, link, key=_stamp)
                while links[0].stamp_ns < links[-1].stamp_ns - _KEPT_NS:
                    links.pop(0)

    def has(self, frame: str) -> bool:
        """Return whether a frame has a parent."""
        return frame in self._links

    def find(self, target: str, source: str, stamp_ns: int) -> tuple[Floats, Floats] | None:
        """Return translation [m] and rotation matrix from source to target; None if unknown.

        Between two transforms it is interpolated, and beyond the last one it is unknown.
        """
        chains = [self._chain(frame, stamp_ns) for frame in (target, source)]
        for frame, of_target in chains[0].items():
            if frame in chains[1]:
                way = np.linalg.solve(of_target, chains[1][frame])
                return way[:3, 3], way[:3, :3]
        return None

    def _chain(self, frame: str, stamp_ns: int) -> dict[str, Floats]:
        """Return a frame and its ancestors, with the matrices that lead there, shape (4, 4)."""
        matrix: Floats = np.eye(4)
        chain = {frame: matrix}
        while len(chain) < _MOST_FRAMES and (link := self._at(frame, stamp_ns)) is not None:
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = matrix_of(link.turn), link.translation_m
            frame, matrix = link.parent, step @ matrix
            chain[frame] = matrix
        return chain

    def _at(self, child: str, stamp_ns: int) -> _Link | None:
        links = self._links.get(child, [])
        if child in self._fixed:
            return links[0]
        after = bisect(links, stamp_ns, key=_stamp)
        if after == 0:
            return None
        before = links[after - 1]
        if before.stamp_ns == stamp_ns:
            return before
        if after == len(links):
            return None
        then = links[after]
        share = (stamp_ns - before.stamp_ns) / (then.stamp_ns - before.stamp_ns)
        way = (1 - share) * before.translation_m + share * then.translation_m
        side = np.sign(before.turn @ then.turn) or 1.0  # of two quaternions of one turn
        return _Link(
            stamp_ns, before.parent, way, (1 - share) * before.turn + share * side * then.turn
        )


def _stamp(link: _Link) -> int:
    return link.stamp_ns
