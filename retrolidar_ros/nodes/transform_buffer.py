# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A buffer of transforms for machines without tf2_ros: a part of tf2's."""

from __future__ import annotations

from bisect import bisect, insort
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import TransformStamped

from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of, quaternion_of

_KEPT_NS = 10_000_000_000
_MOST_FRAMES = 100  # from a frame to its root: a ring of frames has none


class _Link(NamedTuple):
    stamp_ns: int
    parent: str
    translation_m: tuple[float, ...]
    turn: tuple[float, ...]


class TransformBuffer:
    """Keeps the transforms of the last ten seconds."""

    def __init__(self) -> None:
        """Begin without any."""
        self._links: dict[str, list[_Link]] = {}
        self._fixed: set[str] = set()

    def clear(self) -> None:
        """Forget all but static transforms."""
        self._links = {child: self._links[child] for child in self._fixed}

    def take(self, transforms: Iterable[TransformStamped], *, static: bool) -> None:
        """Take transforms."""
        for one in transforms:
            way, turn = one.transform.translation, one.transform.rotation
            link = _Link(
                to_ns(one.header.stamp),
                one.header.frame_id,
                (way.x, way.y, way.z),
                (turn.x, turn.y, turn.z, turn.w),
            )
            if static:
                self._fixed.add(one.child_frame_id)
                self._links[one.child_frame_id] = [link]
            elif one.child_frame_id not in self._fixed:
                links = self._links.setdefault(one.child_frame_id, [])
                insort(links, link)
                while links[0].stamp_ns < links[-1].stamp_ns - _KEPT_NS:
                    links.pop(0)

    def has(self, frame: str) -> bool:
        """Return whether a frame has a parent."""
        return frame in self._links

    def find(self, target: str, source: str, stamp_ns: int) -> tuple[Floats, Floats] | None:
        """Return rotation (x, y, z, w) and translation [m] from source to target; None if unknown.

        Between two transforms it is interpolated, and beyond the last one it is unknown.
        """
        chains = [self._chain(frame, stamp_ns) for frame in (target, source)]
        for frame, of_target in chains[0].items():
            if frame in chains[1]:
                way = np.linalg.solve(of_target, chains[1][frame])
                return quaternion_of(way[:3, :3]), way[:3, 3]
        return None

    def _chain(self, frame: str, stamp_ns: int) -> dict[str, Floats]:
        """Return a frame and its ancestors, with the matrices that lead there, shape (4, 4)."""
        matrix: Floats = np.eye(4)
        chain = {frame: matrix}
        while len(chain) < _MOST_FRAMES:
            link = self._at(frame, stamp_ns)
            if link is None:
                break
            step = np.eye(4)
            step[:3, :3], step[:3, 3] = matrix_of(np.array(link.turn)), link.translation_m
            frame, matrix = link.parent, step @ matrix
            chain[frame] = matrix
        return chain

    def _at(self, child: str, stamp_ns: int) -> _Link | None:
        links = self._links.get(child, [])
        if child in self._fixed:
            return links[0]
        after = bisect(links, stamp_ns, key=lambda link: link.stamp_ns)
        if after == 0:
            return None
        before = links[after - 1]
        if before.stamp_ns == stamp_ns:
            return before
        if after == len(links):
            return None
        share = (stamp_ns - before.stamp_ns) / (links[after].stamp_ns - before.stamp_ns)
        ways = np.array([before.translation_m, links[after].translation_m])
        turns = np.array([before.turn, links[after].turn])
        turns[1] *= np.sign(turns[0] @ turns[1]) or 1.0
        weights = [1 - share, share]
        way, turn = (tuple((weights @ both).tolist()) for both in (ways, turns))
        return _Link(stamp_ns, before.parent, way, turn)
