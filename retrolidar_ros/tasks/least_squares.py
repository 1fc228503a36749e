# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where an object is, and how it is turned, by nonlinear least squares over readings."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import cross_matrix, matrix_of_turn
from retrolidar_ros.tasks.reading import Errors, Reading, Readings

_MOST_STEPS, _FEW_STEPS = 30, 6
_SMALL_STEP = 1e-5  # [m] or [rad]
_MOST_STEP = 0.5
TURN_VARIANCE = math.pi**2 / 3
"""Of an angle that can be anything [rad²]."""
# Student's t of so many degrees of freedom is what ranges are thought to follow, and residuals
# raise the covariance as if so many more had been as expected.
_FREEDOM = 5.0


@dataclass(frozen=True, eq=False)
class State:
    """Pose and motion of an object in the fixed frame."""

    position_m: Floats
    """Shape (3,)."""
    rotation: Floats
    """Turns directions of the object into those of the fixed frame, shape (3, 3)."""
    velocity: Floats
    """Shape (3,) [m/s]."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What was known of a pose before any reading."""

    state: State
    covariance: Floats
    """Of position [m²] and rotation about the fixed axes [rad²], shape (6, 6)."""


@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate, and how well each reading agrees with it."""

    state: State
    covariance: Floats
    """Of position, rotation about the fixed axes and velocity, shape (9, 9)."""
    stamp_s: float
    """When it holds."""
    scores: Floats
    """Of range and of both directions: residuals in their deviations, shape (n, 3)."""


class Problem:
    """Readings of the markers of one object."""

    def __init__(
        self,
        markers: Mapping[int, Floats],
        readings: Sequence[Reading],
        errors: Errors,
        prior: Prior | None = None,
        place_variance: Mapping[int, Floats] | None = None,
    ) -> None:
        """Pose it.

        Parameters
        ----------
        markers : mapping of int to array, shape (3,)
            Where each is on the object [m].
        readings : sequence of Reading
            At least one, of these markers.
        errors : Errors
            What their errors share.
        prior : Prior or None
            Of its pose.
        place_variance : mapping of int to array, shape (3, 3), or None
            How well the places on the object are known [m²]; None: for certain.
        """
        self.seen = Readings(readings)
        self.errors = errors
        self.prior = prior
        self.stamp_s = float(self.seen.stamp_s.max())
        self._before_s = self.stamp_s - self.seen.stamp_s
        self._places = np.array([markers[one] for one in self.seen.marker])
        self._doubt = (
            None
            if place_variance is None
            else np.array([place_variance[one] for one in self.seen.marker])
        )
        turns = len({tuple(place) for place in markers.values()}) > 1
        moves = errors.acceleration > 0
        self._free = np.repeat([True, turns, moves], 3)
        self._turns = turns

    def start(self) -> State:
        """Return a first guess: the mean of all places, and the best of 24 orientations."""
        seen = self.seen
        unit = np.cross(seen.axes[:, 0], seen.axes[:, 1])
        places = seen.sensor_m + seen.range_m[:, None] * unit
        guesses = [
            State((places - self._places @ turn.T).mean(axis=0), turn, np.zeros(3))
            for turn in (_QUARTER_TURNS if self._turns else _QUARTER_TURNS[:1])
        ]
        return min((self._descend(guess, _FEW_STEPS) for guess in guesses), key=self._cost)

    def solve(self, start: State | None = None) -> Fit:
        """Return the estimate that is found from a first guess."""
        return self.spread_at(self._descend(self.start() if start is None else start, _MOST_STEPS))

    def spread_at(self, state: State) -> Fit:
        """Return a state as an estimate: how well the readings tell it."""
        jacobian, residual = self._linearised(state)
        spread: Floats = np.zeros((9, 9))
        for _ in range(3):
            variance = self._variance(state, residual, spread)
            weight = np.linalg.inv(variance)
            spread = self._spread(jacobian, weight)
        chi2 = float(residual[:, 0] @ weight[0] @ residual[:, 0])
        more = max(len(residual) - 3, 0)
        scale = max((_FREEDOM + chi2) / (_FREEDOM + more), 1.0)
        told = np.einsum('nck,kl,ncl->nc', jacobian, spread, jacobian)
        whole = np.diagonal(variance, axis1=1, axis2=2).T
        scores = residual / np.sqrt(np.maximum(whole - told, 0.2 * whole))
        return Fit(state, scale * spread, self.stamp_s, scores)

    def scores(self, fit: Fit) -> Floats:
        """Return how far readings are from an estimate that they are no part of, shape (n, 3)."""
        jacobian, residual = self._linearised(fit.state)
        variance = self._variance(fit.state, 0 * residual, fit.covariance)
        told = np.einsum('nck,kl,ncl->nc', jacobian, fit.covariance, jacobian)
        scores: Floats = residual / np.sqrt(np.diagonal(variance, axis1=1, axis2=2).T + told)
        return scores

    def _spread(self, jacobian: Floats, weight: Floats) -> Floats:
        """Return the covariance of the state, shape (9, 9)."""
        free = self._free
        spread: Floats = np.diag(np.repeat([0.0, TURN_VARIANCE, 0.0], 3))
        information = self._information(jacobian, weight)
        spread[np.ix_(free, free)] = np.linalg.inv(information[np.ix_(free, free)])
        return spread

    def _information(self, jacobian: Floats, weight: Floats) -> Floats:
        information: Floats = np.einsum(
            'nck,cnm,mcl->kl', jacobian, weight, jacobian, optimize=True
        )
        known = np.repeat([0.0, 1 / TURN_VARIANCE, 1 / self.errors.speed**2], 3)
        information += np.diag(known)
        if self.prior is not None:
            information[:6, :6] += np.linalg.inv(self.prior.covariance)
        return information

    def _descend(self, state: State, steps: int) -> State:
        """Follow Gauss and Newton."""
        free = self._free
        spread: Floats = np.zeros((9, 9))
        for _ in range(steps):
            jacobian, residual = self._linearised(state)
            weight = np.linalg.inv(self._variance(state, residual, spread))
            information = self._information(jacobian, weight)
            slope = np.einsum('nck,cnm,mc->k', jacobian, weight, residual, optimize=True)
            slope[6:] -= state.velocity / self.errors.speed**2
            if self.prior is not None:
                turn = self.prior.state.rotation @ state.rotation.T
                vector = np.array([turn[2, 1], turn[0, 2], turn[1, 0]]) - np.array(
                    [turn[1, 2], turn[2, 0], turn[0, 1]]
                )
                off = np.append(self.prior.state.position_m - state.position_m, vector / 2)
                slope[:6] += np.linalg.solve(self.prior.covariance, off)
            step = np.zeros(9)
            step[free] = np.linalg.solve(information[np.ix_(free, free)], slope[free])
            largest = float(np.abs(step).max())
            step *= min(1.0, _MOST_STEP / max(largest, 1e-12))
            state = State(
                state.position_m + step[:3],
                matrix_of_turn(step[3:6]) @ state.rotation,
                state.velocity + step[6:],
            )
            spread = self._spread(jacobian, weight)
            if largest < _SMALL_STEP:
                break
        return state

    def _cost(self, state: State) -> float:
        _, residual = self._linearised(state)
        weight = np.linalg.inv(self._variance(state, residual, np.zeros((9, 9))))
        return float(np.einsum('nc,cnm,mc', residual, weight, residual))

    def _sight(self, state: State) -> Floats:
        turned = self._places @ state.rotation.T
        moved = np.outer(self._before_s, state.velocity)
        sight: Floats = state.position_m + turned - moved - self.seen.sensor_m
        return sight

    def _linearised(self, state: State) -> tuple[Floats, Floats]:
        """Return derivatives, shape (n, 3, 9), and residuals, shape (n, 3)."""
        sight = self._sight(state)
        range_m = np.maximum(np.linalg.norm(sight, axis=1), 1e-3)
        unit = sight / range_m[:, None]
        axes = self.seen.axes
        aside = np.einsum('nck,nk->nc', axes, unit)
        residual = np.column_stack([self.seen.range_m - range_m, -aside])
        per_place = np.empty((len(range_m), 3, 3))
        per_place[:, 0] = unit
        per_place[:, 1:] = (axes - aside[..., None] * unit[:, None]) / range_m[:, None, None]
        jacobian = np.empty((len(range_m), 3, 9))
        jacobian[..., :3] = per_place
        jacobian[..., 3:6] = -per_place @ cross_matrix(self._places @ state.rotation.T)
        jacobian[..., 6:] = -per_place * self._before_s[:, None, None]
        return jacobian, residual

    def _variance(self, state: State, residual: Floats, spread: Floats) -> Floats:
        """Return the covariance of all errors, shape (3, n, n), at a state of some spread."""
        sight = self._sight(state)
        variance: Floats = self.seen.covariance(sight, self._before_s, self.errors)
        range_m = np.linalg.norm(sight, axis=1)
        unit = sight / range_m[:, None]
        if self._doubt is not None:
            doubt = state.rotation @ self._doubt @ state.rotation.T
            same = np.equal.outer(self.seen.marker, self.seen.marker)
            frames = np.concatenate([unit[:, None], self.seen.axes], axis=1)
            known = np.einsum('ick,ikl,jcl->cij', frames, doubt, frames) * same
            known[1:] /= np.outer(range_m, range_m)
            variance += known
        # Spheres bend away from the planes that they are taken for, as far as a place is open.
        across = np.eye(3) - unit[:, :, None] * unit[:, None]
        open_m2 = across @ spread[:3, :3] @ across
        trace = np.trace(open_m2, axis1=1, axis2=2)
        square = np.einsum('nij,nji->n', open_m2, open_m2)
        bend = np.sqrt(trace**2 + 2 * square) / (2 * range_m)
        variance[0] += np.outer(bend, bend)
        count = np.arange(len(range_m))
        deviation = np.sqrt(variance[0, count, count])
        excess = np.maximum((residual[:, 0] / deviation) ** 2 - 1, 0.0) / (_FREEDOM + 1)
        variance[0, count, count] += excess * self.seen.range_stddev_m**2
        return variance


def _quarter_turns() -> list[Floats]:
    """Return the 24 rotations that turn a cube into itself."""
    turns = []
    for order in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), order] = signs
            if np.linalg.det(matrix) > 0:
                turns.append(matrix)
    return sorted(turns, key=lambda turn: -float(np.trace(turn)))


_QUARTER_TURNS = _quarter_turns()
