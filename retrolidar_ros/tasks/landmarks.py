# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Landmarks: objects that carry markers, placed by all readings that belong to them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.least_squares import TURN_VARIANCE, Problem
from retrolidar_ros.tasks.reading import Errors, Reading
from retrolidar_ros.tasks.state import Fit, Prior, largest_stddev

# Gating: a reading with a residual beyond so many standard deviations is an outlier.
_GATE = 4.5
# A landmark is initialised when so many more readings agree than do not. It has moved when as many
# outliers agree with each other.
_AGREEING = 2
# So many if they could be another landmark under a wrong ID, or if only their directions are off.
_AGREEING_IF_AMBIGUOUS = 4
# Ranges of a larger standard deviation, absolutely or relative to the best, do not count.
_VAGUE_M, _VAGUE = 0.02, 5.0
_MAX_READINGS = 40
_MAX_OUTLIERS = 6
_MOVING_WINDOW_S = 8.0
_ONE_VIEW_M = 0.05
# Above this standard deviation all orientations are tried again [rad].
_ROTATION_UNKNOWN = 0.2


@dataclass(frozen=True, eq=False)
class Estimate:
    """Where a landmark is."""

    name: str
    stamp_s: float
    """When it holds: at the last reading; if it moves, up to when all sensors have reported."""
    position_m: Floats
    """Shape (3,), in the fixed frame."""
    rotation: Floats
    """Turns directions of the object into those of the fixed frame, shape (3, 3)."""
    velocity: Floats
    """Shape (3,) [m/s]."""
    covariance: Floats
    """Of the position [m²] and the rotation about the fixed axes [rad²], shape (6, 6)."""
    readings: int
    """How many readings it is made of."""
    baseline_m: float
    """Largest distance between the sensors' places."""
    rejected: int
    """How many readings were outliers, since the beginning."""
    moved_s: float | None
    """When it was last found elsewhere."""

    @property
    def stddev_m(self) -> float:
        """Deviation of the position along the axis in which it is largest."""
        return largest_stddev(self.covariance[:3, :3])


class Landmark:
    """One object: its readings, and the place that is estimated from them."""

    def __init__(
        self,
        name: str,
        markers: Mapping[int, Floats],
        errors: Errors,
        prior: Prior | None = None,
        place_variance: Mapping[int, Floats] | None = None,
    ) -> None:
        """Wait for readings; all but the name is as in `Problem`."""
        self.name = name
        self.errors = errors
        self._markers = markers
        self._place_variance = place_variance
        self._known = prior
        self.restart()

    def restart(self) -> None:
        """Begin again without any reading, with what was known before."""
        self.rejected = 0
        self.moved_s: float | None = None
        self.fit: Fit | None = None
        self.members: list[Reading] = []
        self._prior = self._known
        self._is_initialised = self._known is not None
        self._outliers: list[Reading] = []
        self._valid_from_s = -math.inf
        self._is_settled = True
        self._estimate: Estimate | None = None
        if self._known is not None:
            spread = np.zeros((9, 9))
            spread[:6, :6] = self._known.covariance
            none = np.zeros((0, 2))
            self.fit = Fit(self._known.state, spread, -math.inf, np.zeros((0, 3)), none, none)

    def take(self, *readings: Reading, others: Sequence[Landmark] = ()) -> list[Reading]:
        """Take readings, and return the inliers; those of other markers are ignored.

        An outlier that fits one of `others` may have a wrong ID. ValueError if readings cannot be
        solved; then none is taken.
        """
        before = {
            name: value.copy() if isinstance(value, list) else value
            for name, value in vars(self).items()
        }
        try:
            with np.errstate(all='ignore'):  # `_settle` refuses what is not finite
                for reading in filter(lambda one: one.marker in self._markers, readings):
                    self._add(reading, others)
                self._settle()
        except np.linalg.LinAlgError as error:
            vars(self).update(before)
            raise ValueError(f'readings that cannot be solved: {self.name}') from error
        members = set(map(id, self.members))
        return [one for one in readings if id(one) in members]

    def _add(self, reading: Reading, others: Sequence[Landmark]) -> None:
        self._estimate = None
        if reading.stamp_s < self._valid_from_s:
            self.rejected += 1
            return
        fits = self.fit is None or not self._knows_rotation()
        scores = np.zeros(3) if fits else self._scores(reading)
        if scores.max() < _GATE:
            self.members.append(reading)
            if self._is_initialised:
                self._outliers = [one for one in self._outliers if one.stamp_s > reading.stamp_s]
            self._prune()
            self._is_settled = False
            if not self._is_initialised:  # until then any reading may be the outlier
                self._settle()
            return
        self.rejected += 1
        ambiguous = scores[0] < _GATE or any(one.could_be(reading) for one in others)
        self._relocate(reading, _AGREEING_IF_AMBIGUOUS if ambiguous else _AGREEING)

    def _settle(self) -> None:
        """Compute the place from the readings added since."""
        if not self._is_settled:
            self._is_settled, self._estimate = True, None
            self._solve()
            assert self.fit is not None
            state = self.fit.state
            if not np.isfinite([*state.position_m, *self.fit.covariance.ravel()]).all():
                raise np.linalg.LinAlgError('not finite')
            self._initialise()

    def could_be(self, reading: Reading) -> bool:
        """Return whether a reading agrees with the place of one of its markers, whatever its ID."""
        found = self.estimate()
        if found is None or not self._markers:
            return False
        # Most are too near or too far; this check is cheap.
        errors, stddev_m = self.errors, found.stddev_m
        apart_m = float(np.linalg.norm(found.position_m - reading.pose.position_m))
        arm_m = max(float(np.linalg.norm(place)) for place in self._markers.values())
        open_m = stddev_m + 2 * stddev_m**2 / reading.range_m + reading.range_stddev_m
        open_m += errors.pose_m + errors.range_bias_m + errors.range_m
        if not errors.acceleration and abs(apart_m - reading.range_m) > arm_m + _GATE * open_m:
            return False
        own = [self._scores(reading._replace(marker=one)) for one in self._markers]
        return bool(min(scores.max() for scores in own) < _GATE)

    def has(self, marker: int) -> bool:
        """Tell whether a marker is one of its own."""
        return marker in self._markers

    def estimate(self) -> Estimate | None:
        """Return where the landmark is; None until readings agree, or it was known before."""
        if self._estimate is None and self.fit is not None and self._is_initialised:
            self._estimate = self._estimate_of(self.fit)
        return self._estimate

    def _estimate_of(self, fit: Fit) -> Estimate:
        state = fit.state
        places = np.array([one.pose.position_m for one in self.members]).reshape(-1, 3)
        apart = np.linalg.norm(places[:, None] - places, axis=-1)
        covariance = fit.covariance[:6, :6]
        if len(self._markers) == 1:
            covariance = covariance.copy()
            covariance[3:, 3:] = np.eye(3) * TURN_VARIANCE
        return Estimate(
            name=self.name,
            stamp_s=fit.stamp_s,
            position_m=state.position_m,
            rotation=state.rotation,
            velocity=state.velocity,
            covariance=covariance,
            readings=len(self.members),
            baseline_m=float(apart.max(initial=0.0)),
            rejected=self.rejected,
            moved_s=self.moved_s,
        )

    def spread_with(self, readings: Sequence[Reading], beside: int | None = None) -> Floats:
        """Return the covariance of the position with further ranges, shape (3, 3) [m²].

        Their markers may include one more ID, `beside`, at the place of the first.
        """
        assert self.fit is not None
        markers = dict(self._markers)
        if beside is not None:
            markers[beside] = next(iter(markers.values()))
        return self._problem([*self.members, *readings], markers).spread(self.fit)[:3, :3]

    def _problem(
        self, readings: Sequence[Reading], markers: Mapping[int, Floats] | None = None
    ) -> Problem:
        known = self._prior, self._place_variance
        return Problem(markers or self._markers, readings, self.errors, *known)

    def _can_initialise(self, readings: Sequence[Reading], needed: int) -> bool:
        """Return whether so many readings have ranges that are exact enough."""
        noise = np.array([one.range_stddev_m / one.range_m**2 for one in readings])
        best = min([one.range_stddev_m / one.range_m**2 for one in self.members], default=np.inf)
        telling = noise < _VAGUE * min(best, noise.min())
        telling &= np.array([one.range_stddev_m for one in readings]) < _VAGUE_M
        return bool(telling.sum() >= needed)

    def _scores(self, reading: Reading) -> Floats:
        """Return by how many deviations range and direction are off, shape (3,)."""
        assert self.fit is not None
        fit = self.fit
        if self.errors.acceleration and self.members:
            # The reading may be older or newer than the estimate.
            fit = self._problem([*self.members, reading]).solve(fit)
            most: Floats = np.abs(fit.scores).max(axis=0)
            return most
        scores: Floats = np.abs(self._problem([reading]).scores(fit)[0])
        return scores

    def _solve(self) -> None:
        """Fit all members, without outliers."""
        while True:
            start = self.fit if self._knows_rotation() else None
            # A copy: the members change while the estimate stays.
            self.fit = self._problem(tuple(self.members)).solve(start)
            scores = np.abs(self.fit.scores).max(axis=1)
            worst = int(scores.argmax())
            if scores[worst] < _GATE or len(self.members) <= _AGREEING:
                return
            del self.members[worst]
            self.rejected += 1

    def _knows_rotation(self) -> bool:
        if self.fit is None or len(self._markers) == 1:
            return self.fit is not None
        turning = self.fit.covariance[3:6, 3:6]
        return largest_stddev(turning) < _ROTATION_UNKNOWN

    def _relocate(self, reading: Reading, needed: int) -> None:
        """Restart from a reading and outliers that agree with it, if no member is newer."""
        self._outliers.append(reading)
        if self.members and reading.stamp_s < max(one.stamp_s for one in self.members):
            return
        for others in itertools.combinations(self._outliers[-_MAX_OUTLIERS:-1], needed - 1):
            agreeing = [*others, reading]
            if not self._can_initialise(agreeing, _AGREEING):
                continue
            fit = Problem(self._markers, tuple(agreeing), self.errors).solve()
            if np.abs(fit.scores).max() < _GATE:
                self.rejected -= needed
                if self._is_initialised:
                    self.moved_s = reading.stamp_s
                    self._valid_from_s = min(one.stamp_s for one in agreeing)
                    self._outliers = []
                else:
                    self.rejected += len(self.members)
                    kept = set(map(id, agreeing))
                    self._outliers = [one for one in self._outliers if id(one) not in kept]
                    self._outliers += self.members
                self.members, self._prior = agreeing, None
                self.fit, self._is_settled = fit, True
                self._initialise()
                return

    def _initialise(self) -> None:
        """Publish the landmark from now on if enough of its readings agree."""
        if not self._is_initialised:
            needed = _AGREEING + len(self._outliers)
            self._is_initialised = self._can_initialise(self.members, needed)

    def _prune(self) -> None:
        """Keep views from many places of an object at rest, and the latest of a moving one."""
        self.members.sort(key=lambda one: one.stamp_s)
        if self.errors.acceleration:
            oldest_s = self.members[-1].stamp_s - _MOVING_WINDOW_S
            self.members = [one for one in self.members if one.stamp_s >= oldest_s]
        while len(self.members) > _MAX_READINGS:
            places = np.array([one.pose.position_m for one in self.members])
            near = np.linalg.norm(places[:, None] - places, axis=-1) < _ONE_VIEW_M
            # The oldest of the view with most readings; the newest always stays.
            del self.members[int(near.sum(axis=1)[:-1].argmax())]
