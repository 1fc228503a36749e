# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""All landmarks: data association by name, and readings that wait to be solved."""

from collections import deque
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.landmarks import Estimate, Landmark
from retrolidar_ros.tasks.reading import Errors, KnownPose, Reading

MAX_LANDMARKS = 500  # of a survey: as many fit into a file that is read
_ORIGIN = np.zeros(3)
_MAX_WAITING = 8  # readings of a landmark


class Survey:
    """Landmarks by name; a marker without a name is a landmark of its own."""

    def __init__(
        self,
        objects: Mapping[str, Mapping[int, Floats]],
        errors: Errors,
        known: Mapping[str, KnownPose] | None = None,
    ) -> None:
        """Begin with objects, the places (3,) [m] of their markers by ID, and a former survey."""
        self.landmarks: dict[str, Landmark] = {}
        self._objects = objects
        self._errors = errors
        self._known = known or {}
        self.restart()

    def take(self, name: str, *readings: Reading) -> Landmark:
        """Take readings of one landmark, and return that.

        ValueError if another marker has this name, there are too many landmarks, or readings cannot
        be solved.
        """
        landmark = self._landmark(name, readings[0].marker)
        landmark.take(*readings)
        return landmark

    def _landmark(self, name: str, marker: int) -> Landmark:
        known = self.landmarks.get(name)
        if known is not None and known.has(marker):
            return known
        if known is not None and known.members and known.estimate() is not None:
            raise ValueError(f'two markers have one name, each needs its own: {marker}, {name}')
        if known is None and len(self.landmarks) >= MAX_LANDMARKS:
            unsure = [one for one, landmark in self.landmarks.items() if not landmark.estimate()]
            if not unsure:
                raise ValueError(f'{MAX_LANDMARKS} landmarks are the most; left out: {name}')
            del self.landmarks[unsure[0]]
        return self._begin(name, self._objects.get(name, {marker: _ORIGIN}))

    def restart(self) -> None:
        """Begin again with what was known before all readings, as time does in a replay."""
        self.landmarks.clear()
        for name in self._known:
            self._begin(name, self._objects.get(name, {}))

    def forget(self) -> None:
        """Forget all landmarks, those of a former survey, too."""
        self._known = {}
        self.restart()

    def estimates(self) -> list[Estimate]:
        """Return what is known."""
        found = [landmark.estimate() for landmark in self.landmarks.values()]
        return [one for one in found if one is not None]

    def _begin(self, name: str, markers: Mapping[int, Floats]) -> Landmark:
        fresh = Landmark(name, markers, self._errors, self._known.get(name))
        self.landmarks[name] = fresh
        return fresh


class Batch(NamedTuple):
    """The waiting readings of one landmark."""

    name: str
    readings: deque[Reading]
    since_s: float  # when the first of them came


class Backlog:
    """A bounded queue of landmarks: who waits longest is next, with all its readings at once."""

    def __init__(self) -> None:
        self.dropped = 0  # readings that were dropped for newer ones of their landmark
        self._batches: dict[str, Batch] = {}

    def __len__(self) -> int:
        """Return how many readings wait."""
        return sum(len(one.readings) for one in self._batches.values())

    def add(self, name: str, reading: Reading, now_s: float) -> None:
        """Queue a reading of a landmark."""
        if name not in self._batches:
            self._batches[name] = Batch(name, deque(maxlen=_MAX_WAITING), now_s)
        readings = self._batches[name].readings
        self.dropped += len(readings) == _MAX_WAITING
        readings.append(reading)

    def pop(self) -> Batch:
        """Return the batch that waits longest."""
        return self._batches.pop(next(iter(self._batches)))

    def clear(self) -> None:
        """Empty the queue."""
        self._batches.clear()
