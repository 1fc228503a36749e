# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Landmarks: objects that carry markers, placed by all readings that belong to them."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.least_squares import TURN_VARIANCE, Problem
from retrolidar_ros.tasks.reading import Errors, Fit, KnownPose, Reading, State

_GATE = 4.5  # gating: a reading with a residual beyond so many standard deviations is an outlier
# A landmark is initialised when so many more readings agree than do not, and it has moved when so
# many outliers agree.
_AGREEING, _MOVED = 2, 3
_VAGUE_M = 0.02  # less certain ranges are left out: what stands behind a marker shifts them
_MAX_READINGS = 40
_MAX_OUTLIERS = 6
_MOVING_WINDOW_S = 8.0
_ONE_VIEW_M = 0.05
_ROTATION_UNKNOWN = 0.2  # above this standard deviation all orientations are tried again [rad]


@dataclass(frozen=True, eq=False)
class Estimate:
    """Where a landmark is."""

    name: str
    stamp_s: float  # when it holds: at the last reading, or, if it moves, that of all sensors
    position_m: Floats  # shape (3,), in the fixed frame
    rotation: Floats  # turns directions of the object into those of the fixed frame, shape (3, 3)
    velocity: Floats  # shape (3,) [m/s]
    covariance: Floats  # of position [m²] and rotation about the fixed axes [rad²], shape (6, 6)
    readings: int  # how many readings it is made of
    baseline_m: float  # largest distance between the sensors' places
    rejected: int  # how many readings were outliers, since the beginning
    moved_s: float | None  # when it was last found elsewhere

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
        prior: KnownPose | None = None,
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
        self._is_updated = True
        self._estimate: Estimate | None = None
        if self._known is not None:
            position_m, rotation, covariance = self._known
            spread = np.pad(covariance, (0, 3))
            state = State(position_m, rotation, np.zeros(3))
            self.fit = Fit(state, spread, -math.inf, np.zeros((0, 3)))

    def take(self, *readings: Reading) -> list[Reading]:
        """Take readings, and return the inliers; those of other markers are ignored.

        ValueError if readings cannot be solved; then none is taken.
        """
        before = {
            name: value.copy() if isinstance(value, list) else value
            for name, value in vars(self).items()
        }
        try:
            with np.errstate(all='ignore'):  # `_update` refuses what is not finite
                for reading in filter(lambda one: one.marker in self._markers, readings):
                    self._add(reading)
                self._update()
        except np.linalg.LinAlgError as error:
            vars(self).update(before)
            raise ValueError(f'readings that cannot be solved: {self.name}') from error
        members = set(map(id, self.members))
        return [one for one in readings if id(one) in members]

    def _add(self, reading: Reading) -> None:
        self._estimate = None
        if reading.stamp_s < self._valid_from_s or reading.range_stddev_m > _VAGUE_M:
            self.rejected += 1
        elif not self._knows_rotation() or self._score(reading) < _GATE:
            self.members.append(reading)
            if self._is_initialised:
                self._outliers = [one for one in self._outliers if one.stamp_s > reading.stamp_s]
            self._prune()
            self._is_updated = False
            if not self._is_initialised:  # until then any reading may be the outlier
                self._update()
        else:
            self.rejected += 1
            self._outliers.append(reading)
            if not self.members or reading.stamp_s >= max(one.stamp_s for one in self.members):
                self._relocate(reading)

    def _update(self) -> None:
        if not self._is_updated:
            self._is_updated, self._estimate = True, None
            self._solve()
            assert self.fit is not None
            state = self.fit.state
            if not np.isfinite([*state.position_m, *self.fit.covariance.ravel()]).all():
                raise np.linalg.LinAlgError('not finite')
            self._initialise()

    def has(self, marker: int) -> bool:
        """Return whether it carries a marker."""
        return marker in self._markers

    def estimate(self) -> Estimate | None:
        """Return where the landmark is; None until readings agree, or it was known before."""
        fit = self.fit
        if self._estimate is None and fit is not None and self._is_initialised:
            places = np.array([one.pose.position_m for one in self.members]).reshape(-1, 3)
            apart = np.linalg.norm(places[:, None] - places, axis=-1)
            covariance = fit.covariance[:6, :6].copy()
            if len(self._markers) == 1:
                covariance[3:, 3:] = np.eye(3) * TURN_VARIANCE
            self._estimate = Estimate(
                name=self.name,
                stamp_s=fit.stamp_s,
                position_m=fit.state.position_m,
                rotation=fit.state.rotation,
                velocity=fit.state.velocity,
                covariance=covariance,
                readings=len(self.members),
                baseline_m=float(apart.max(initial=0.0)),
                rejected=self.rejected,
                moved_s=self.moved_s,
            )
        return self._estimate

    def spread_with(self, readings: Sequence[Reading]) -> Floats:
        """Return the covariance of the position with further ranges, shape (3, 3) [m²]."""
        assert self.fit is not None
        problem = self._problem([*self.members, *readings])
        return problem.covariance_with(self.fit, len(self.members))[:3, :3]

    def _problem(self, readings: Sequence[Reading]) -> Problem:
        return Problem(self._markers, readings, self.errors, self._prior, self._place_variance)

    def _score(self, reading: Reading) -> float:
        """Return by how many deviations range or direction are off."""
        assert self.fit is not None
        if self.errors.acceleration and self.members:
            # The reading may be older or newer than the estimate.
            fit = self._problem([*self.members, reading]).solve(self.fit)
            return float(np.abs(fit.scores).max())
        return float(np.abs(self._problem([reading]).scores(self.fit)).max())

    def _solve(self) -> None:
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

    def _relocate(self, reading: Reading) -> None:
        """Restart from a reading and outliers that agree with it."""
        others = self._outliers[-_MAX_OUTLIERS:-1]
        for chosen in itertools.combinations(others, _MOVED - 1):
            agreeing = [*chosen, reading]
            fit = Problem(self._markers, tuple(agreeing), self.errors).solve()
            if np.abs(fit.scores).max() >= _GATE:
                continue
            if self._is_initialised:
                self.rejected -= _MOVED
                self.moved_s = reading.stamp_s
                self._valid_from_s = min(one.stamp_s for one in agreeing)
                self._outliers = []
            else:
                self.rejected += len(self.members) - _MOVED
                kept = set(map(id, agreeing))
                self._outliers = [one for one in self._outliers if id(one) not in kept]
                self._outliers += self.members
            self.members, self._prior = agreeing, None
            self.fit, self._is_updated = fit, True
            self._initialise()
            return

    def _initialise(self) -> None:
        """Publish the landmark from now on if enough of its readings agree."""
        self._is_initialised |= len(self.members) >= _AGREEING + len(self._outliers)

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
