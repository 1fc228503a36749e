# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A queue of readings that wait for their landmarks to be solved."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from retrolidar_ros.tasks.reading import Reading

_MAX_EACH = 8


class Batch(NamedTuple):
    """The waiting readings of one landmark."""

    name: str
    readings: deque[Reading]
    since_s: float
    """When the first of them came."""


class Backlog:
    """A bounded queue of landmarks: who waits longest is next, with all its readings at once."""

    def __init__(self) -> None:
        """Begin empty."""
        self.dropped = 0
        """Readings that were dropped for newer ones of their landmark."""
        self._batches: dict[str, Batch] = {}

    def __len__(self) -> int:
        """Return how many readings wait."""
        return sum(len(one.readings) for one in self._batches.values())

    def add(self, name: str, reading: Reading, now_s: float) -> None:
        """Queue a reading of a landmark."""
        if name not in self._batches:
            self._batches[name] = Batch(name, deque(maxlen=_MAX_EACH), now_s)
        readings = self._batches[name].readings
        self.dropped += len(readings) == _MAX_EACH
        readings.append(reading)

    def pop(self) -> Batch:
        """Return the batch that waits longest."""
        return self._batches.pop(next(iter(self._batches)))

    def clear(self) -> None:
        """Empty the queue."""
        self._batches.clear()
