# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The next viewpoint of a sensor, and remedies if no viewpoint suffices."""

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.sensor.frame import Floats, ZoneGrid
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.reading import Reading, SensorPose

_DIRECTIONS = np.array([one for one in itertools.product((-1, 0, 1), repeat=3) if any(one)], float)
_NEAREST_M = 0.3
# From the axis: within the two middle columns and rows of zones, and half of the outer ones.
_IN_VIEW = math.atan(1.5 * ZoneGrid().pitch)
_ARRIVED_M = 0.05
# What is tried, as shares of the reach and of the distance.
_WIDER, _NEARER = (1.25, 1.5, 2.0, 2.5, 3.0), (0.9, 0.8, 0.7, 0.6, 0.5)


class ViewPlanner:
    """Chooses the next viewpoint, and keeps it until the sensor can have reached it.

    It changes once all objects that it is for are known or were read from there, or after `move_s`.
    """

    def __init__(self) -> None:
        self.reach_m = self.move_s = math.nan
        """How far the sensor can go from where it read first [m], and how long that takes [s]."""
        self.heights_m = (-math.inf, math.inf)  # minimum and maximum z of a viewpoint [m]
        self.max_stddev_m = math.nan  # wanted standard deviation of landmarks [m]
        self.forget()

    def forget(self) -> None:
        """Begin again without a viewpoint."""
        self.view: SensorPose | None = None  # next viewpoint, in the fixed frame, if any
        self.remedies: dict[str, str] = {}  # by name, where no viewpoint suffices
        self._began_m: Floats | None = None
        self._since_s = -math.inf
        self._wanted: set[str] = set()

    def take(self, reading: Reading, name: str, missing: Mapping[str, Landmark | None]) -> None:
        """Take the last reading, and the objects not known well enough; choose a view if due."""
        if self._began_m is None:
            self._began_m = reading.pose.position_m
        if (view := self.view) is not None:
            gone_m = float(np.linalg.norm(reading.pose.position_m - view.position_m))
            if gone_m < _ARRIVED_M:
                self._wanted.discard(name)
        if self._wanted & set(missing) and 0 <= reading.stamp_s - self._since_s < self.move_s:
            return
        seen = {one: mark for one, mark in missing.items() if mark is not None and mark.members}
        if view is None and not any(mark.estimate() for mark in seen.values()):
            return  # so that the first viewpoint is for all that the first place shows
        place_m = best_place(list(seen.values()), self._began_m, self.reach_m, self.heights_m)
        self.view = self._aimed(place_m, reading, seen) if place_m is not None else None
        self._since_s = reading.stamp_s
        remedies = {one: self._remedy(mark) for one, mark in seen.items() if mark.fit is not None}
        self.remedies = {one: text for one, text in remedies.items() if text}

    def _aimed(self, place_m: Floats, last: Reading, seen: Mapping[str, Landmark]) -> SensorPose:
        """Return a pose that looks at all objects, or at the least certain one."""
        names = sorted(seen, key=lambda one: -largest_stddev(seen[one].spread_with(())))
        for group in (names, names[:1]):
            sights = [_position(seen[one]) - place_m for one in group]
            units = np.array([one / np.linalg.norm(one) for one in sights])
            ahead = units.mean(axis=0)
            ahead /= np.linalg.norm(ahead)
            if (units @ ahead > math.cos(_IN_VIEW)).all():
                break
        self._wanted = set(group)
        # Keeps the present roll of the sensor, if possible.
        right = last.pose.rotation[:, 0]
        if abs(right @ ahead) > 0.9:
            right = last.pose.rotation[:, 2]
        right = right - (right @ ahead) * ahead
        right /= np.linalg.norm(right)
        return SensorPose(place_m, np.column_stack([right, np.cross(ahead, right), ahead]))

    def _remedy(self, landmark: Landmark) -> str:
        """Return what would suffice for a landmark; empty if a viewpoint within reach does."""
        assert self._began_m is not None
        wanted_m, place_m = self.max_stddev_m, _position(landmark)
        if self._reached_m(landmark, self._began_m, self.reach_m) <= wanted_m:
            return ''
        found = []
        range_m = float(np.linalg.norm(place_m - self._began_m))
        for share in _NEARER:
            middle_m = place_m + share * (self._began_m - place_m)
            if self._reached_m(landmark, middle_m, self.reach_m) <= wanted_m:
                found.append(f'from {share * range_m:.1f} m')
                break
        for share in _WIDER:
            if self._reached_m(landmark, self._began_m, share * self.reach_m) <= wanted_m:
                found.append(f'with a reach of {share * self.reach_m:.2g} m')
                break
        return ', or '.join(found) or 'nearer and from farther apart'

    def _reached_m(self, landmark: Landmark, middle_m: Floats, reach_m: float) -> float:
        """Return the deviation after one more reading from every place around another."""
        places = _places(middle_m, reach_m, self.heights_m)
        found = (_seen_from(landmark, place_m) for place_m in places)
        return largest_stddev(landmark.spread_with([one for one in found if one is not None]))


def best_place(
    landmarks: Sequence[Landmark],
    middle_m: Floats,
    reach_m: float,
    heights_m: tuple[float, float] = (-math.inf, math.inf),
) -> Floats | None:
    """Return the place from which one more reading of each landmark leaves least mean square error.

    Across the line of sight ranges from there tell the direction; nearer, they are more exact, too.
    It is within `reach_m` of a place, shape (3,) [m], and between two heights, all in the fixed
    frame; None if no landmark has been read.
    """
    seen = [one for one in landmarks if one.fit is not None and one.members]
    places = _places(middle_m, reach_m, heights_m)
    errors = np.array([sum(_error_after(one, place_m) for one in seen) for place_m in places])
    if not seen or not np.isfinite(errors.min(initial=np.inf)):
        return None
    best: Floats = places[int(errors.argmin())]
    return best


def _places(middle_m: Floats, reach_m: float, heights_m: tuple[float, float]) -> Floats:
    """Return places around one, shape (n, 3) [m]."""
    places = middle_m + reach_m * _DIRECTIONS / np.linalg.norm(_DIRECTIONS, axis=1)[:, None]
    within: Floats = places[(places[:, 2] >= heights_m[0]) & (places[:, 2] <= heights_m[1])]
    return within


def _position(landmark: Landmark) -> Floats:
    assert landmark.fit is not None
    return landmark.fit.state.position_m


def _seen_from(landmark: Landmark, place_m: Floats) -> Reading | None:
    """Return a reading of a landmark as it is expected from a place; None if that is too near."""
    last = max(landmark.members, key=lambda one: one.stamp_s)
    range_m = float(np.linalg.norm(_position(landmark) - place_m))
    if range_m < _NEAREST_M:
        return None
    # The noise of a range rises with about its square.
    return last._replace(
        pose=last.pose._replace(position_m=place_m),
        range_m=range_m,
        range_stddev_m=last.range_stddev_m * (range_m / last.range_m) ** 2,
    )


def _error_after(landmark: Landmark, place_m: Floats) -> float:
    """Return the mean squared error with one more reading [m²]; infinite if it is too near."""
    view = _seen_from(landmark, place_m)
    return np.inf if view is None else float(np.trace(landmark.spread_with([view])))
