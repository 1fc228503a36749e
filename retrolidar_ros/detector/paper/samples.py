# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 1 of the paper's method: the last samples of every zone, without gaps."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.sensor.frame import Frame, valid_samples


class LastSamples:
    """The last samples of all zones, oldest first."""

    def __init__(self, zones: int, length: int, frame_period_s: float) -> None:
        """Keep `length` samples of `zones` zones taken every `frame_period_s`."""
        self._length = length
        self.count = 0  # samples taken since the start, gaps included
        self._period_ns = frame_period_s * 1e9
        self._signal = np.zeros((length, zones))
        self._distance = np.full((length, zones), np.nan)
        self._stamp_ns = np.zeros(length, dtype=np.int64)
        self._seen = np.zeros(zones, dtype=bool)
        self.impossible = 0  # samples so far that `valid_samples` calls impossible

    def push(self, frame: Frame) -> Iterator[tuple[int, int]]:
        """Append a frame, and before it what a gap in the stamps has lost, sample by sample.

        Abnormal samples repeat the zone's previous signal (paper §3.5), and so do those of lost
        frames, whose number the stamps give: a frame half a period early or late is still the
        next. Where the stamps go back or leave a gap as long as all that is kept, the samples
        start again. The same stamp is the same frame again, and makes no sample.

        Yields how many samples there are after each one, and the time of the last frame up to it
        [ns].
        """
        normal, impossible = valid_samples(frame.signal, frame.distance, frame.status)
        previous, last_ns = self._signal[-1].copy(), int(self._stamp_ns[-1])
        if self.count and frame.stamp_ns == last_ns:
            return
        self.impossible += impossible
        steps = max(1, round((frame.stamp_ns - last_ns) / self._period_ns))
        if self.count == 0 or frame.stamp_ns < last_ns or steps > self._length:
            self.count = 0
            steps = 1
            self._seen[:] = False
        first_seen = normal & ~self._seen
        if first_seen.any():
            # Before its first normal sample a zone is taken to have been as bright as then: a
            # rise from nothing would look like the end of a dark bit.
            self._signal[:, first_seen] = frame.signal[first_seen]
            previous[first_seen] = frame.signal[first_seen]
            self._seen |= first_seen
        for step in range(1, steps):
            self._append(previous, np.nan, last_ns + round(step * self._period_ns))
            yield self.count, last_ns
        signal = np.where(normal, frame.signal, previous)
        distance = np.where(normal, frame.distance, np.nan)
        self._append(signal, distance, frame.stamp_ns)
        yield self.count, frame.stamp_ns

    def _append(
        self, signal: NDArray[np.floating], distance: NDArray[np.floating] | float, stamp_ns: int
    ) -> None:
        self.count += 1
        for kept, newest in (
            (self._signal, signal),
            (self._distance, distance),
            (self._stamp_ns, stamp_ns),
        ):
            kept[:-1] = kept[1:]
            kept[-1] = newest

    def signal(self, samples: int, before: int = 0) -> NDArray[np.float64]:
        """Return signals [kcps/SPAD] before the newest ones, shape (samples, zones), a view."""
        end = self._length - before
        return self._signal[end - samples : end]

    def distance(self, samples: int) -> NDArray[np.float64]:
        """Return the last distances [m], NaN where none was measured, (samples, zones), a view."""
        return self._distance[-samples:]

    def first_ns(self, samples: int) -> int:
        """Return the time of the first of the last samples [ns]."""
        return int(self._stamp_ns[-samples])
