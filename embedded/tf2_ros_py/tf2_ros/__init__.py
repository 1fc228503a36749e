# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The part of tf2_ros that this package needs, for the embedded environment: it has no wheel."""

from __future__ import annotations

from bisect import bisect, insort
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.time import Time
from tf2_msgs.msg import TFMessage

from retrolidar_ros.nodes.conversion import (
    quaternion_in,
    to_header,
    to_ns,
    to_pose,
    to_transform,
    vector_of,
)
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of, quaternion_of

_Add = Callable[[TransformStamped, str], None]
_UNIT = 0.01
_KEPT_NS = 10_000_000_000
_MAX_FRAMES = 100  # from a frame to its root: a ring of frames has none


class TransformBroadcaster:
    """Sends transforms to `/tf`."""

    def __init__(self, node: Node) -> None:
        """Send with `node`."""
        self._publisher = node.create_publisher(TFMessage, '/tf', 100)

    def sendTransform(self, transforms: list[TransformStamped]) -> None:  # noqa: N802
        """Send transforms."""
        self._publisher.publish(TFMessage(transforms=transforms))


class TransformListener:
    """Fills a buffer with what is sent to TF."""

    def __init__(self, buffer: Buffer, node: Node) -> None:
        """Subscribe with `node`."""
        latched = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        for topic, qos, add in (
            ('/tf', QoSProfile(depth=100), buffer.set_transform),
            ('/tf_static', latched, buffer.set_transform_static),
        ):

            def on_transforms(message: TFMessage, add: _Add = add) -> None:
                for transform in message.transforms:
                    add(transform, 'TF')

            node.create_subscription(TFMessage, topic, on_transforms, qos)


class _Link(NamedTuple):
    """A transform from a frame to its parent."""

    stamp_ns: int
    parent: str
    translation_m: Floats
    quaternion: Floats


class Buffer:
    """Keeps the transforms of the last ten seconds."""

    def __init__(self) -> None:
        """Begin without any."""
        self._links: dict[str, list[_Link]] = {}
        self._static: set[str] = set()

    def clear(self) -> None:
        """Forget all but static transforms."""
        self._links = {child: self._links[child] for child in self._static}

    def set_transform(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform that holds at its stamp, if it is one."""
        child, link = transform.child_frame_id, _link(transform)
        if child not in self._static and _is_pose(link):
            links = self._links.setdefault(child, [])
            insort(links, link, key=_stamp)
            while links[0].stamp_ns < links[-1].stamp_ns - _KEPT_NS:
                links.pop(0)

    def set_transform_static(self, transform: TransformStamped, authority: str) -> None:
        """Add a transform that holds always, if it is one."""
        if _is_pose(link := _link(transform)):
            self._static.add(transform.child_frame_id)
            self._links[transform.child_frame_id] = [link]

    def all_frames_as_yaml(self) -> str:
        """Return the frames that have a parent, and that."""
        pairs = [(child, links[-1].parent) for child, links in self._links.items()]
        return '\n'.join(f"{child}: \n  parent: '{parent}'" for child, parent in pairs)

    def can_transform(self, target: str, source: str, time: Time) -> bool:
        """Return whether a transform is known."""
        return self._find(target, source, time.nanoseconds) is not None

    def lookup_transform(self, target: str, source: str, time: Time) -> TransformStamped:
        """Return the transform from a source to a target frame; LookupError if it is unknown.

        Between two transforms it is interpolated, and beyond the last one it is unknown.
        """
        matrix = self._find(target, source, time.nanoseconds)
        if matrix is None:
            raise LookupError(f'no transform from {source} to {target}')
        pose = to_pose(matrix[:3, 3], quaternion_of(matrix[:3, :3]))
        return to_transform(to_header(time.nanoseconds, target), source, pose)

    def _find(self, target: str, source: str, stamp_ns: int) -> Floats | None:
        """Return the matrix from source to target, shape (4, 4); None if it is unknown."""
        of_target, of_source = (self._chain(frame, stamp_ns) for frame in (target, source))
        for frame, matrix in of_target.items():
            if frame in of_source:
                found: Floats = np.linalg.solve(matrix, of_source[frame])
                return found
        return None

    def _chain(self, frame: str, stamp_ns: int) -> dict[str, Floats]:
        """Return a frame and its ancestors, with the matrices that lead there, shape (4, 4)."""
        matrix: Floats = np.eye(4)
        chain = {frame: matrix}
        while len(chain) < _MAX_FRAMES and (link := self._at(frame, stamp_ns)) is not None:
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = matrix_of(link.quaternion), link.translation_m
            frame, matrix = link.parent, step @ matrix
            chain[frame] = matrix
        return chain

    def _at(self, child: str, stamp_ns: int) -> _Link | None:
        links = self._links.get(child, [])
        if child in self._static:
            return links[0]
        after = bisect(links, stamp_ns, key=_stamp)
        if after == 0:
            return None
        old = links[after - 1]
        if old.stamp_ns == stamp_ns:
            return old
        if after == len(links):
            return None
        new = links[after]
        share = (stamp_ns - old.stamp_ns) / (new.stamp_ns - old.stamp_ns)
        sign = np.sign(old.quaternion @ new.quaternion) or 1.0  # two quaternions of one rotation
        return _Link(
            stamp_ns,
            old.parent,
            (1 - share) * old.translation_m + share * new.translation_m,
            (1 - share) * old.quaternion + share * sign * new.quaternion,
        )


def _is_pose(link: _Link) -> bool:
    """Return whether all are numbers, and the quaternion is of length 1, as tf2 demands."""
    length = float(link.quaternion @ link.quaternion)
    return bool(np.isfinite(link.translation_m).all() and abs(length - 1) < _UNIT)


def _link(transform: TransformStamped) -> _Link:
    return _Link(
        to_ns(transform.header.stamp),
        transform.header.frame_id,
        vector_of(transform.transform.translation),
        quaternion_in(transform.transform.rotation),
    )


def _stamp(link: _Link) -> int:
    return link.stamp_ns
