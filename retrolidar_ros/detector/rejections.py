# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rejected candidates, without those that a read packet explains."""

from __future__ import annotations

from collections import Counter, deque
from typing import TYPE_CHECKING

import numpy as np

from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import ZoneGrid

if TYPE_CHECKING:
    from retrolidar_ros.detector.detection import Detection
    from retrolidar_ros.detector.likelihood_detector import Candidate

_SETTLED_PACKETS = 1.5  # by then, any packet that explains a candidate has been read
_SLACK = 0.1  # of a packet
_READ = 256  # newest readings that candidates are compared with


def adjacency(grid: ZoneGrid) -> np.ndarray[tuple[int, int], np.dtype[np.bool_]]:
    """Return which zones are the same or neighbours, shape (zones, zones)."""
    place = np.stack(np.divmod(np.arange(grid.zones), grid.columns))
    near: np.ndarray[tuple[int, int], np.dtype[np.bool_]] = (
        np.abs(place[:, :, None] - place[:, None]).max(axis=0) <= 1
    )
    return near


class Rejections:
    """Counts rejected candidates, once it is certain that no packet explains them."""

    def __init__(self, grid: ZoneGrid) -> None:
        """Begin at zero."""
        self.counts: Counter[str] = Counter()
        self._near = adjacency(grid)
        self._pending: deque[tuple[int, Candidate]] = deque()
        self._read: deque[Detection] = deque(maxlen=_READ)

    def take(self, candidates: list[Candidate], detections: list[Detection], now_ns: int) -> None:
        """Take the candidates and the readings of a frame."""
        self.settle(now_ns)
        self._pending += ((now_ns, one) for one in candidates if one.reason is not None)
        self._read += detections

    def settle(self, now_ns: int) -> None:
        """Count the candidates that are old enough and not explained."""
        while self._pending:
            judged_ns, one = self._pending[0]
            packet_ns = PACKET_BITS * one.bit_period_s * 1e9
            if 0 <= now_ns - judged_ns < _SETTLED_PACKETS * packet_ns:
                break
            self._pending.popleft()
            if one.reason is not None and not self._is_read(one, packet_ns):
                self.counts[one.reason.value] += 1

    def _is_read(self, candidate: Candidate, packet_ns: float) -> bool:
        """Return whether something was read in, or beside, a candidate's zone, at its time."""
        zones = len(self._near)
        # Where only an end of a packet was seen, its time is not known well.
        begin_ns = candidate.start_ns - _SLACK * packet_ns
        end_ns = candidate.start_ns + (1 + _SLACK) * packet_ns
        return any(
            one.start_ns < end_ns
            and begin_ns < one.end_ns
            and (candidate.zone >= zones or self._near[candidate.zone, list(one.zones)].any())
            for one in self._read
        )
