# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of bit periods: the detector tells which one reads.

What blinks by bits shorter than two frames looks as if it blinked by longer ones (an alias), and
by bits of one frame it has no clock that could be seen. Only the detector tells.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import FRAMES_A_BIT, Recording

Read = Callable[[Recording, float], list[Detection]]  # reads a recording with a bit period [s]
CAPTURE = 0.02  # relative error of a bit period that a detector makes up for
# Frames a bit, 5 % apart, nearest to two first.
_GRID = sorted(np.geomspace(1.0, 9.0, 46).tolist(), key=lambda frames: abs(np.log2(frames / 2)))
_SURE = 0.4  # of a recording


class Trial(NamedTuple):
    """The detections of a recording with a bit period."""

    tried_s: float
    detections: list[Detection]

    @property
    def bit_period_s(self) -> float:
        """As measured by the detections [s]; that of the trial if there are none."""
        measured_s = [one.bit_period_s for one in self.detections]
        return float(np.median(measured_s)) if measured_s else self.tried_s

    @property
    def evidence(self) -> float:
        """Sum over its detections [nats]."""
        return sum(one.evidence for one in self.detections)

    def within(self, zone: int) -> Trial:
        """Return the detections in a zone."""
        return self._replace(detections=[one for one in self.detections if zone in one.zones])

    def is_sure(self, recording: Recording) -> bool:
        """Whether so much of a recording was read that no other bit period needs a trial."""
        read_ns = len(self.detections) * PACKET_BITS * self.bit_period_s * 1e9
        return read_ns > _SURE * float(recording.stamp_ns[-1] - recording.stamp_ns[0])

    @property
    def agrees(self) -> bool:
        """Whether an ID was read twice: by a wrong bit period a wrong one is read, now and then."""
        return max(Counter(one.id for one in self.detections).values(), default=0) > 1


def best(done: Iterable[Trial], recording: Recording, likely_s: list[float]) -> Trial | None:
    """Return the trial with the most evidence of those that several readings or a clock confirm."""
    trusted = (
        one
        for one in done
        if one.agrees
        or one.is_sure(recording)
        or (one.detections and is_among(one.tried_s, likely_s))
    )
    return max(trusted, key=lambda one: one.evidence, default=None)


def candidates(clocks_s: Iterable[float], frame_s: float) -> list[float]:
    """Return the bit periods [s] of which frames every `frame_s` may show clocks."""
    min_s, max_s = (frames * frame_s for frames in FRAMES_A_BIT)
    found: list[float] = []
    for clock_s in clocks_s:
        alias_s = frame_s / (1 - frame_s / clock_s) if clock_s > frame_s else clock_s
        for one in (clock_s, alias_s):
            if min_s <= one <= max_s and not is_among(one, found):
                found.append(one)
    return found if not found or is_among(frame_s, found) else [*found, frame_s]


def every(frame_s: float) -> list[float]:
    """Return all bit periods that frames every `frame_s` can show [s]."""
    return [frames * frame_s for frames in _GRID]


def trials(
    recording: Recording, periods_s: Iterable[float], read: Read, refused_s: Iterable[float] = ()
) -> Iterator[Trial]:
    """Read a recording with bit periods [s], except those near to others or refused ones."""
    tried = [*refused_s]
    for bit_s in periods_s:
        if not is_among(bit_s, tried):
            tried.append(bit_s)
            yield Trial(bit_s, read(recording, bit_s))


def is_among(bit_s: float, others: list[float]) -> bool:
    """Return whether a bit period [s] is captured by a detector of one of the others."""
    return any(abs(bit_s / one - 1) < CAPTURE for one in others)
