# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where an object is, and how it is turned, by nonlinear least squares over readings."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import QUARTER_TURNS, cross_matrix, matrix_of_turn, turn_of
from retrolidar_ros.tasks.reading import Errors, Fit, KnownPose, Reading, State, axes_of

_MAX_STEPS, _FEW_STEPS = 60, 8
_SMALL_STEP = 1e-5  # [m] or [rad]
_MAX_STEP = 0.5
_SOMEWHERE = 1e-6  # all is within a kilometre or so, which keeps equations solvable [1/m²]
TURN_VARIANCE = math.pi**2 / 3  # of an angle that can be anything [rad²]
# Share of the variance of a range that its readings from one place have in common: a background or
# another marker in the zone shifts them in the same way.
_SHARED = 0.25
_LASTING_S = 3.0  # correlation time of the acceleration of a moving marker
_SILENT_S = 2.0  # a sensor without a reading for so long does not see the marker
_ALIKE_M = 0.05  # distance within which the errors of a sensor correlate [m]


class Problem:
    """Readings of the markers of one object."""

    def __init__(
        self,
        markers: Mapping[int, Floats],
        readings: Sequence[Reading],
        errors: Errors,
        prior: KnownPose | None = None,
        place_variance: Mapping[int, Floats] | None = None,
    ) -> None:
        """State the problem of one or more readings, whose pose may have a prior.

        `markers` says where each is on the object, shape (3,) [m], and `place_variance` how
        uncertain that is, shape (3, 3) [m²]; without it, places are exact.
        """
        self.errors = errors
        self.prior = prior
        self._turns = len({tuple(place) for place in markers.values()}) > 1
        self._free = np.repeat([True, self._turns, errors.acceleration > 0], 3)
        variances = place_variance or {}
        self._places = np.array([markers[one.marker] for one in readings])
        self._place_variance: Floats = np.array(
            [variances.get(one.marker, np.zeros((3, 3))) for one in readings]
        )
        self._marker = np.array([one.marker for one in readings])
        self._range_m = np.array([one.range_m for one in readings])
        self._half_box = math.sqrt(3) * np.array([one.spread_rad for one in readings])
        self._half_box += errors.box_rad
        self._sensor_m = np.array([one.pose.position_m for one in readings])
        rotation = np.array([one.pose.rotation for one in readings])
        direction = np.array([one.direction for one in readings])
        own = np.concatenate([axes_of(direction), direction[:, None]], axis=1)
        axes = own @ rotation.swapaxes(1, 2)
        self._axes = axes[:, :2]  # across the directions, in the fixed frame, shape (n, 2, 3)
        self._direction = axes[:, 2]  # as measured, in the fixed frame, shape (n, 3)
        stamp_s = np.array([one.stamp_s for one in readings])
        sensor = np.array([one.sensor for one in readings])
        self._stamp_s = float(stamp_s.max())
        """When the estimate holds: if the marker moves, up to when all sensors have reported."""
        if errors.acceleration:
            newest_s = np.array([stamp_s[sensor == one].max() for one in set(sensor.tolist())])
            self._stamp_s = float(newest_s[newest_s > self._stamp_s - _SILENT_S].min())
        self._before_s = self._stamp_s - stamp_s  # how long before that each was taken
        self._moved_m2 = errors.acceleration**2 * _wandered(self._before_s)
        apart = np.linalg.norm(self._sensor_m[:, None] - self._sensor_m, axis=-1)
        self._one_sensor = sensor[:, None] == sensor
        self._one_pose = self._one_sensor * np.exp(-0.5 * (apart / _ALIKE_M) ** 2)
        self._one_marker = self._marker[:, None] == self._marker
        shared = _SHARED * self._one_pose * self._one_marker
        np.fill_diagonal(shared, 1.0)
        stddev_m = np.array([one.range_stddev_m for one in readings])
        self._own_m2 = shared * np.outer(stddev_m, stddev_m)

    def solve(self, start: Fit | None = None) -> Fit:
        """Return the estimate, from an earlier one or from the best of many guesses."""
        if start is not None:
            return self._descend(start.state, _MAX_STEPS, start.covariance)
        places = self._sensor_m + self._range_m[:, None] * self._direction
        guesses = [
            State((places - self._places @ rotation.T).mean(axis=0), rotation, np.zeros(3))
            for rotation in (QUARTER_TURNS if self._turns else QUARTER_TURNS[:1])
        ]
        if len(guesses) > 1:
            guesses.sort(key=lambda guess: self._misfit(self._descend(guess, _FEW_STEPS)))
        return self._descend(guesses[0], _MAX_STEPS)

    def _misfit(self, fit: Fit) -> float:
        """Return minus twice the log likelihood of the readings under an estimate."""
        squared = float(np.square(fit.scores).sum())
        if self.prior is not None:
            before, now = self.prior, fit.state
            turned = turn_of(now.rotation @ before.rotation.T)
            off = np.concatenate([now.position_m - before.position_m, turned])
            squared += float(off @ np.linalg.solve(self.prior.covariance, off))
        return squared

    def scores(self, fit: Fit) -> Floats:
        """Return the scores of readings that the estimate does not include, shape (n, 3)."""
        jacobian, residual, range_m2, edge_rad2 = self._linearised(fit.state, fit.covariance)
        known = _variance_of(jacobian, fit.covariance)
        return self._scores(residual, np.diag(range_m2) + known[:, 0], edge_rad2 + known[:, 1:])

    def covariance_with(self, fit: Fit, known: int) -> Floats:
        """Return the state's covariance (9, 9) with the ranges of readings after `known`."""
        return self._inverse(self._equations(fit.state, fit.covariance, known)[0])

    def _descend(self, state: State, steps: int, covariance: Floats | None = None) -> Fit:
        """Take Gauss-Newton steps from a state, whose covariance may be known."""
        spread: Floats = np.zeros((9, 9)) if covariance is None else covariance
        for _ in range(steps):
            information, slope, *variances = self._equations(state, spread, len(self._marker))
            before, spread = spread, self._inverse(information)
            step = spread @ slope * self._free
            largest = float(np.abs(step).max())
            step *= min(1.0, _MAX_STEP / max(largest, 1e-12))
            state = State(
                state.position_m + step[:3],
                matrix_of_turn(step[3:6]) @ state.rotation,
                state.velocity + step[6:],
            )
            change = np.abs(spread - before)[:3, :3].max()
            if largest < _SMALL_STEP and change < 1e-3 * spread[:3, :3].max():
                break
        jacobian, residual, *_ = self._linearised(state, spread)
        range_m2, edge_rad2 = variances
        usual = np.diag(range_m2)
        own = np.maximum(usual - _variance_of(jacobian[:, 0], spread), 0.2 * usual)
        scores = self._scores(residual, own, edge_rad2)
        return Fit(state, spread, self._stamp_s, scores)

    def _scores(self, residual: Floats, range_m2: Floats, edge_rad2: Floats) -> Floats:
        beyond = np.maximum(np.abs(residual[:, 1:]) - self._half_box, 0.0)
        return np.column_stack([residual[:, 0] / np.sqrt(range_m2), beyond / np.sqrt(edge_rad2)])

    def _inverse(self, information: Floats) -> Floats:
        """Return the covariance of the state, shape (9, 9)."""
        free = np.ix_(self._free, self._free)
        spread: Floats = np.diag(np.repeat([0.0, 0.0 if self._turns else TURN_VARIANCE, 0.0], 3))
        spread[free] = np.linalg.inv(information[free])
        return spread

    def _equations(
        self, state: State, spread: Floats, directions: int
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return information and slope at a state, of all ranges and of the first directions.

        The variances of both, too, as `_linearised` does.
        """
        jacobian, residual, range_m2, edge_rad2 = self._linearised(state, spread)
        weighted = jacobian[:, 0].T @ np.linalg.inv(range_m2)
        information, slope = weighted @ jacobian[:, 0], weighted @ residual[:, 0]
        self._add_prior(state, information, slope)
        bearing, per_state = residual[:, 1:], jacobian[:, 1:]
        weights = 1 / (self._half_box**2 / 3 + edge_rad2)  # shape (n, 2) [1/rad²]
        weights /= _redundancy(self._axes, self._marker, bearing, self._half_box)
        weights[directions:] = 0
        rows = per_state.reshape(-1, 9)
        information += (rows * weights.reshape(-1, 1)).T @ rows
        slope += np.tensordot(weights * bearing, per_state)
        return information, slope, range_m2, edge_rad2

    def _add_prior(self, state: State, information: Floats, slope: Floats) -> None:
        """Add what is known without readings (in place)."""
        still = 1 / self.errors.speed**2
        information += np.diag(np.repeat([_SOMEWHERE, 1 / TURN_VARIANCE, still], 3))
        slope[6:] -= still * state.velocity
        if self.prior is not None:
            # Sines of rotations: in a rotation vector, a large yaw would mix with the tilt.
            turned = self.prior.rotation @ state.rotation.T
            sines = np.array([turned[2, 1], turned[0, 2], turned[1, 0]])
            sines -= np.array([turned[1, 2], turned[2, 0], turned[0, 1]])
            off = np.append(self.prior.position_m - state.position_m, sines / 2)
            known = np.linalg.inv(self.prior.covariance)
            information[:6, :6] += known
            slope[:6] += known @ off

    def _linearised(self, state: State, spread: Floats) -> tuple[Floats, Floats, Floats, Floats]:
        """Return derivatives and residuals at a state with a covariance, and variances of these.

        Shapes are (n, 3, 9) and (n, 3). Of ranges, the third is the covariance (n, n), and of the
        edges of boxes, the last is the variance (n, 1).
        """
        errors, places = self.errors, self._places @ state.rotation.T
        begin_m = self._sensor_m + np.outer(self._before_s, state.velocity)
        sight = state.position_m + places - begin_m
        range_m = np.maximum(np.linalg.norm(sight, axis=1), 1e-3)
        unit = sight / range_m[:, None]
        aside = (self._axes @ unit[..., None])[..., 0]
        residual = np.column_stack([self._range_m - range_m, -aside])
        per_place = np.empty((len(range_m), 3, 3))
        per_place[:, 0] = unit
        per_place[:, 1:] = (self._axes - aside[..., None] * unit[:, None]) / range_m[:, None, None]
        jacobian = np.empty((len(range_m), 3, 9))
        jacobian[..., :3] = per_place
        jacobian[..., 3:6] = -per_place @ cross_matrix(places)
        jacobian[..., 6:] = -per_place * self._before_s[:, None, None]
        range_m2: Floats = (errors.pose_m**2 * self._one_pose + self._moved_m2) * (unit @ unit.T)
        range_m2 += errors.range_bias_m**2 * self._one_sensor + self._own_m2
        if self._place_variance.any():
            place_m2 = state.rotation @ self._place_variance @ state.rotation.T
            range_m2 += (unit[:, None] @ place_m2 @ unit.T)[:, 0] * self._one_marker
        range_m2.flat[:: len(range_m2) + 1] += errors.range_m**2
        bend = _curvature(spread[:3, :3], unit, range_m)
        range_m2 += np.outer(bend, bend)
        across_m2 = errors.pose_m**2 + np.diag(self._moved_m2)
        edge_rad2 = errors.edge_rad**2 + errors.turn_rad**2 + across_m2 / range_m**2
        return jacobian, residual, range_m2, edge_rad2[:, None]


def _curvature(place_m2: Floats, unit: Floats, range_m: Floats) -> Floats:
    """Return the standard deviations of spheres of ranges from their planes, shape (n,) [m].

    It is sqrt(tr(PS)² + 2 tr(PSPS)) / 2r, with S the covariance of the place and P the projection
    across a direction.
    """
    seen = unit @ place_m2
    along, aslant = (seen * unit).sum(axis=1), (seen * seen).sum(axis=1)
    square = (place_m2 * place_m2).sum() - 2 * aslant + along**2
    trace = np.trace(place_m2) - along
    bend: Floats = np.sqrt(np.maximum(trace**2 + 2 * square, 0.0)) / (2 * range_m)
    return bend


def _redundancy(axes: Floats, marker: NDArray[np.int64], bearing: Floats, half: Floats) -> Floats:
    """Return how many directions (n, 2) tell the same: of a marker at one place of their boxes."""
    rows, place, size = axes.reshape(-1, 3), bearing.ravel(), half.ravel()
    apart = np.abs(place[:, None] - place) / np.minimum.outer(size, size)
    alike = (rows @ rows.T) ** 2 * np.maximum(1 - 2 * apart, 0)
    alike *= np.repeat(np.repeat(marker[:, None] == marker, 2, axis=0), 2, axis=1)
    count: Floats = alike.sum(axis=1).reshape(half.shape)
    return count


def _variance_of(jacobian: Floats, covariance: Floats) -> Floats:
    """Return the variances of J·x, shape (...), for jacobians J of shape (..., k)."""
    variance: Floats = ((jacobian @ covariance) * jacobian).sum(axis=-1)
    return variance


def _wandered(before_s: Floats) -> Floats:
    """Return the covariance of displacements for an acceleration of variance 1 [s⁴].

    It is a Gauss-Markov process, whose correlation falls off in `_LASTING_S` (Singer 1970). Times
    before and after that of the estimate have opposite signs.
    """
    tau, apart_s = _LASTING_S, np.abs(before_s)
    short, long = np.minimum.outer(apart_s, apart_s), np.maximum.outer(apart_s, apart_s)
    white = tau * short**2 * (long - short / 3)
    early = (long + tau) * (short + tau * np.expm1(-short / tau))
    late = tau * (np.exp((short - long) / tau) - np.exp(-long / tau))
    late -= short * np.exp(-long / tau)
    same = white - tau**2 * early + tau**3 * late
    across = tau * (apart_s + tau * np.expm1(-apart_s / tau))
    return np.where(np.outer(before_s, before_s) < 0, np.outer(across, across), same)
