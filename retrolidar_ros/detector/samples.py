# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 1: the last samples of every zone, abnormal ones eliminated, gaps filled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.frame import Frame, Status

# A blinking marker itself makes the sensor report "first range" and "no previous target" at its
# dark-to-bright edges: to hold the previous value there would erase what is to be read.
NORMAL_STATUS = (
    Status.VALID,
    Status.FIRST_RANGE,
    Status.MERGED,
    Status.NO_PREVIOUS_TARGET,
)


class SampleRing:
    """The last samples of all zones as contiguous arrays, oldest first.

    Every sample is written twice, one length apart, so that the last `length` of them are
    always one slice and nothing is moved or allocated.
    """

    def __init__(self, zones: int, length: int, frame_period_s: float) -> None:
        """Keep `length` samples of `zones` zones taken every `frame_period_s`."""
        self.length = length
        self.count = 0
        """Samples taken since the start, gaps included."""
        self._period_ns = frame_period_s * 1e9
        self._signal = np.zeros((2 * length, zones))
        self._distance = np.full((2 * length, zones), np.nan)
        self._stamp_ns = np.zeros(2 * length, dtype=np.int64)
        self._normal = np.zeros(256, dtype=bool)
        self._normal[list(NORMAL_STATUS)] = True

    def push(self, frame: Frame) -> int:
        """Append a frame; return how many samples it made, or 0 if the samples begin anew.

        Abnormal samples repeat the zone's previous signal (paper §3.5). The same is done for
        the samples of lost frames, which are counted by the stamps: half a period early or
        late is still the next sample. Where the stamps go back or leave a gap longer than
        the ring, nothing that was held belongs to the same packet any more.
        """
        normal = self._normal[frame.status]
        steps = 1
        if self.count:
            last_ns = self._stamp_ns[(self.count - 1) % self.length]
            steps = max(1, round((frame.stamp_ns - last_ns) / self._period_ns))
            if frame.stamp_ns <= last_ns or steps > self.length:
                self.count = 0
                steps = 0
        if self.count:
            previous = self._signal[(self.count - 1) % self.length].copy()
        else:
            previous = np.where(normal, frame.signal, 0.0)
        for _ in range(steps - 1):
            self._append(previous, np.nan, frame.stamp_ns)
        signal = np.where(normal, frame.signal, previous)
        distance = np.where(normal, frame.distance, np.nan)
        self._append(signal, distance, frame.stamp_ns)
        return steps

    def _append(
        self, signal: NDArray[np.floating], distance: NDArray[np.floating] | float, stamp_ns: int
    ) -> None:
        first = self.count % self.length
        for row in (first, first + self.length):
            self._signal[row] = signal
            self._distance[row] = distance
            self._stamp_ns[row] = stamp_ns
        self.count += 1

    def _last(self, samples: int, until: int) -> slice:
        """Return where `samples` samples lie that end `until` samples before the newest."""
        end = (self.count - 1) % self.length + 1 + self.length - until
        return slice(end - samples, end)

    def signal(self, samples: int, until: int = 0) -> NDArray[np.float64]:
        """Return signals [kcps/SPAD], shape (samples, zones), a view."""
        return self._signal[self._last(samples, until)]

    def distance(self, samples: int, until: int = 0) -> NDArray[np.float64]:
        """Return distances [m], NaN where none was measured, shape (samples, zones), a view."""
        return self._distance[self._last(samples, until)]

    def stamp_ns(self, samples: int, until: int = 0) -> NDArray[np.int64]:
        """Return times [ns], shape (samples,), a view; those of a gap are of the frame after."""
        return self._stamp_ns[self._last(samples, until)]
