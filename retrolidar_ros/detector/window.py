# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 1: the last samples of every zone, placed by their times, each with its weight."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.frame import Floats, Recording, Status, valid_samples

# A zone that has seen something not longer ago than this may be looking at a dark bit when it
# sees nothing; no packet is dark for longer than nine bits at a stretch.
_DARK_BITS = 12


class Samples(NamedTuple):
    """Samples of consecutive frames, oldest first."""

    time_s: Floats
    """Middle of each exposure since the window's origin [s], shape (samples,)."""
    signal: Floats
    """[kcps/SPAD], shape (samples, zones); 0 where the weight is 0."""
    weight: Floats
    """1, or 0 for an erasure, shape (samples, zones)."""
    distance: Floats
    """[m], NaN where none was measured, shape (samples, zones)."""
    begin_s: Floats
    """When each exposure began [s], shape (samples,)."""
    end_s: Floats
    """When it ended; exposures never overlap [s], shape (samples,)."""

    def at(self, rows: NDArray[np.bool_]) -> Samples:
        """Return some of the samples."""
        return Samples(*(values[rows] for values in self))


class SampleWindow:
    """The newest samples of all zones; older ones are forgotten.

    A lost frame leaves a gap in the times and nothing else. Abnormal samples are erasures, but
    "no target" in a zone that has just had one is a dark sample: a marker that blocks the light
    leaves nothing to see. So is "signal too low", unless the signal that comes with it is none.
    """

    def __init__(self, zones: int, length: int, bit_period_s: float) -> None:
        """Keep at least `length` samples of `zones` zones."""
        self._length = length
        capacity = 4 * length
        self._time_s = np.zeros(capacity)
        self._signal = np.zeros((capacity, zones))
        self._weight = np.zeros((capacity, zones))
        self._distance = np.full((capacity, zones), np.nan)
        self._begin_s = np.zeros(capacity)
        self._end_s = np.zeros(capacity)
        self._half_s = bit_period_s / 4  # of an exposure, two of which make a bit
        self._dark_s = _DARK_BITS * bit_period_s
        self.impossible = 0
        """Samples so far that `valid_samples` calls impossible."""
        self._arrays = (
            self._time_s,
            self._signal,
            self._weight,
            self._distance,
            self._begin_s,
            self._end_s,
        )
        self.clear(0)

    def clear(self, origin_ns: int) -> None:
        """Forget all samples; times count from `origin_ns` now."""
        self.origin_ns = origin_ns
        self._count = 0
        zones = self._signal.shape[1]
        self._last_seen_s = np.full(zones, -np.inf)
        self._last_signal = np.zeros(zones)

    def __len__(self) -> int:
        """Return how many samples there are."""
        return self._count

    @property
    def first_s(self) -> float:
        """When the oldest exposure that is held for sure began [s]; there must be one."""
        return float(self._begin_s[max(0, self._count - self._length)])

    def append(
        self,
        stamp_ns: NDArray[np.int64],
        signal: Floats,
        distance: Floats,
        status: NDArray[np.uint8],
    ) -> None:
        """Append frames.

        Parameters
        ----------
        stamp_ns : array of int, shape (frames,)
            Rising, and later than all before [ns].
        signal, distance, status : array, shape (frames, zones)
            At most as many frames as the window is long.
        """
        frames = len(stamp_ns)
        if self._count + frames > len(self._time_s):
            kept = slice(self._count - self._length, self._count)
            for held in self._arrays:
                held[: self._length] = held[kept]
            self._count = self._length
        rows = slice(self._count, self._count + frames)
        self._count += frames
        time_s = (stamp_ns - self.origin_ns) * 1e-9
        self._time_s[rows] = time_s
        self._place(rows)
        usable, impossible = valid_samples(signal, distance, status)
        self.impossible += impossible
        if usable.all():
            self._distance[rows] = distance
            self._signal[rows] = signal
            self._weight[rows] = 1.0
            self._last_seen_s[:] = time_s[-1]
            self._last_signal[:] = signal[-1]
            return
        self._distance[rows] = np.where(usable, distance, np.nan)
        seen_s = np.where(usable, time_s[:, None], -np.inf)
        np.maximum.accumulate(seen_s, axis=0, out=seen_s)
        np.maximum(seen_s, self._last_seen_s, out=seen_s)
        self._last_seen_s[:] = seen_s[-1]
        dark = (status == Status.NO_TARGET) | (
            (status == Status.SIGNAL_TOO_LOW) & ~(signal >= self._last_signal / 2)
        )
        dark &= time_s[:, None] - seen_s < self._dark_s
        self._signal[rows] = np.where(usable, signal, 0.0)
        self._weight[rows] = usable | dark
        last = frames - 1 - np.argmax(usable[::-1], axis=0)
        ever = usable.any(axis=0)
        self._last_signal[ever] = signal[last, np.arange(len(last))][ever]

    def _place(self, rows: slice) -> None:
        """Tell when exposures began and ended: half-way between two frames where they are near."""
        time_s, begin_s, end_s = self._time_s, self._begin_s, self._end_s
        for row in range(rows.start, rows.stop):
            middle_s = float(time_s[row])
            begin_s[row] = middle_s - self._half_s
            end_s[row] = middle_s + self._half_s
            if row:
                between_s = (middle_s + float(time_s[row - 1])) / 2
                begin_s[row] = max(float(begin_s[row]), between_s)
                end_s[row - 1] = min(float(end_s[row - 1]), between_s)

    def last(self, samples: int) -> Samples:
        """Return views of the newest samples, fewer where there are not so many."""
        rows = slice(max(0, self._count - samples), self._count)
        return Samples(*(held[rows] for held in self._arrays))


def placed(recording: Recording, frames: int, bit_period_s: float) -> Samples:
    """Return the samples of the first frames of a recording, as a detector holds them."""
    window = SampleWindow(recording.grid.zones, frames, bit_period_s)
    window.clear(int(recording.stamp_ns[0]))
    rows = slice(0, frames)
    window.append(
        recording.stamp_ns[rows],
        recording.signal[rows],
        recording.distance[rows],
        recording.status[rows],
    )
    return window.last(frames)
