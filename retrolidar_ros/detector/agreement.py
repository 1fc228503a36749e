# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings count only if others agree with them: a single one may be a false ID."""

from collections import defaultdict, deque
from collections.abc import Sequence

import numpy as np

from retrolidar_ros.detector.detection import Detection, Track
from retrolidar_ros.marker.code import PACKET_BITS

_MAX_GAP_PACKETS = 12  # a faint marker is read once in eight, and some may be hidden
_MAX_DEVIATIONS = 3.0
_MAX_SPEED = 1.0  # of a marker along the line of sight [m/s]


class Agreement:
    """Confirms a reading once enough readings of its ID agree, itself included.

    They agree if their packets are different ones, no more than twelve packets apart for each that
    is needed, and their ranges differ by no more than three deviations and 1 m/s.
    """

    def __init__(self, min_readings: int) -> None:
        """Begin without any reading; with a minimum of 1 all pass."""
        self._min_readings = min_readings
        self._recent: defaultdict[int, deque[Detection]] = defaultdict(
            lambda: deque(maxlen=4 * min_readings)
        )
        self._passed_ns: dict[int, int] = {}
        self.passed = self.withheld = 0  # counts of readings that were confirmed, and withheld

    def confirmed(self, detections: Sequence[Detection]) -> list[Detection]:
        """Return the new readings that are confirmed."""
        return [one for one in detections if self._is_confirmed(one)]

    def followed(self, tracks: Sequence[Track]) -> list[Track]:
        """Return the tracks of markers with a confirmed reading since they began."""
        # A reading after the track's frame is of before the time went back.
        passed_ns = self._passed_ns
        return [
            one
            for one in tracks
            if one.first_ns <= passed_ns.get(one.id, one.first_ns - 1) <= one.stamp_ns
        ]

    def _is_confirmed(self, reading: Detection) -> bool:
        recent = self._recent[reading.id]
        agreeing = 1 + sum(self._agree(one, reading) for one in recent)
        recent.append(reading)
        is_enough = agreeing >= self._min_readings
        if is_enough:
            self._passed_ns[reading.id] = reading.end_ns
        self.passed += is_enough
        self.withheld += not is_enough
        return is_enough

    def _agree(self, one: Detection, other: Detection) -> bool:
        apart_s = abs(other.stamp_ns - one.stamp_ns) * 1e-9
        packet_s = PACKET_BITS * other.bit_period_s
        if apart_s > _MAX_GAP_PACKETS * packet_s * (self._min_readings - 1):
            return False
        # Packets that are read twice, as when a bag is played again, confirm nothing.
        begun_s = [1e-9 * each.end_ns - each.packets * packet_s for each in (one, other)]
        if 1e-9 * min(one.end_ns, other.end_ns) - max(begun_s) > packet_s / 2:
            return False
        deviation_m = np.hypot(one.place.range_stddev_m, other.place.range_stddev_m)
        allowed_m = _MAX_DEVIATIONS * deviation_m + _MAX_SPEED * apart_s
        return bool(abs(other.place.range_m - one.place.range_m) <= allowed_m)
