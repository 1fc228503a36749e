# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Objects that a task needs, and whether all of them are placed well enough (paper §7.1)."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.sensor.frame import Floats


class Sighting(NamedTuple):
    """Where an object was last seen."""

    stamp_ns: int
    frame_id: str
    position_m: Floats  # in that frame, shape (3,)
    stddev_m: float  # standard deviation of the position along the axis in which it is largest


class ObjectBoard:
    """Keeps the latest sighting of each object, and which are missing."""

    def __init__(self, names: Sequence[str], max_stddev_m: float, stale_after_s: float) -> None:
        """Wait for objects by name; ValueError if there is none, or one comes twice.

        One is placed if its deviation is at most `max_stddev_m`, and it was seen less than
        `stale_after_s` ago.
        """
        if not names:
            raise ValueError('objects: there is no name; name at least one')
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f'objects: {name} comes twice')
        self.names = tuple(names)
        self.max_stddev_m = max_stddev_m
        self.stale_after_s = stale_after_s
        self._sightings: dict[str, Sighting] = {}

    def see(
        self, name: str, stamp_ns: int, frame_id: str, position_m: Floats, covariance: Floats
    ) -> bool:
        """Take a sighting, with its covariance (3, 3); return False if a newer one is known."""
        known = self._sightings.get(name)
        # Much older ones are of a clock that was set back, or of a bag played again.
        if known is not None and 0 < known.stamp_ns - stamp_ns < self.stale_after_s * 1e9:
            return False
        stddev_m = largest_stddev(covariance)
        self._sightings[name] = Sighting(stamp_ns, frame_id, position_m, stddev_m)
        return True

    def missing(self, now_ns: int) -> dict[str, str]:
        """Return the reason for each object that is not placed well enough, by name."""
        reasons = {}
        newest = max(self._sightings.values(), key=lambda one: one.stamp_ns, default=None)
        for name in self.names:
            sighting = self._sightings.get(name)
            if sighting is None:
                reasons[name] = 'has not been seen'
                continue
            age_s = (now_ns - sighting.stamp_ns) * 1e-9
            if abs(age_s) > self.stale_after_s:
                reasons[name] = f'was last seen {age_s:.0f} s ago'
            elif newest is not None and sighting.frame_id != newest.frame_id:
                reasons[name] = f'was seen in {sighting.frame_id}, others in {newest.frame_id}'
            elif sighting.stddev_m > self.max_stddev_m:
                reasons[name] = (
                    f'±{1e3 * sighting.stddev_m:.3g} mm (±{1e3 * self.max_stddev_m:.3g} mm needed)'
                )
        return reasons

    def offsets(self, now_ns: int) -> dict[tuple[str, str], Floats]:
        """Return the vector from one object to another for each pair placed, in order of names."""
        missing = self.missing(now_ns)
        placed = [name for name in self.names if name not in missing]
        return {
            (one, other): self._sightings[other].position_m - self._sightings[one].position_m
            for one, other in itertools.combinations(placed, 2)
        }
