# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A number and how sure it is, and least squares that say so."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats

_NORMAL_95 = 1.96
_ROUNDS = 25
_ENOUGH = 1e-3  # of a sum of squares, by which a round is to lower it
_MOST_DAMPING = 1e6


class Estimate(NamedTuple):
    """A value with its standard deviation."""

    value: float
    stddev: float

    def times(self, factor: float) -> Estimate:
        """Return it in another unit."""
        return Estimate(self.value * factor, self.stddev * abs(factor))

    def inverse(self, of: float) -> Estimate:
        """Return a number divided by it."""
        return Estimate(of / self.value, abs(of) * self.stddev / self.value**2)

    def text(self, unit: str = '') -> str:
        """Return value ± half of the interval that holds the truth in 95 of 100 cases."""
        half = _NORMAL_95 * self.stddev
        digits = 6 if half <= 0 else min(max(1 - _magnitude(half), 0), 6)
        return f'{self.value:.{digits}f} ± {half:.{digits}f}{" " if unit else ""}{unit}'


def _magnitude(number: float) -> int:
    return int(f'{number:e}'.split('e')[1])


def estimates(values: Floats, covariance: Floats, chi2: float, freedom: int) -> list[Estimate]:
    """Return values with their deviations, raised if residuals exceed those of their freedom."""
    deviations = np.sqrt(np.diag(covariance) * max(chi2 / max(freedom, 1), 1.0))
    return [Estimate(*one) for one in zip(values.tolist(), deviations.tolist(), strict=True)]


def least_squares(
    missed: Callable[[Floats], Floats],
    start: Floats,
    steps: Floats,
    bounds: tuple[Floats, Floats],
    freedom: int,
) -> tuple[Floats, list[Estimate]]:
    """Return the values with the least squares, and how sure they are (Levenberg, Marquardt).

    Parameters
    ----------
    missed : callable
        From values to residuals in their standard deviations, shape (residuals,).
    start : array, shape (n,)
        First guess.
    steps : array, shape (n,)
        For slopes.
    bounds : (array, array), each of shape (n,)
        Least and greatest values.
    freedom : int
        Of the residuals.
    """
    values, damping = np.clip(start, *bounds), 1e-3
    left = missed(values)
    for _ in range(_ROUNDS):
        slopes = np.stack(
            [
                (missed(values + one) - missed(values - one)) / (2 * one.max())
                for one in np.diag(steps)
            ],
            axis=-1,
        )
        normal = slopes.T @ slopes
        scale = np.sqrt(np.maximum(np.diag(normal), 1e-12))
        normal /= np.outer(scale, scale)
        gained = 0.0
        while gained <= 0 and damping < _MOST_DAMPING:
            damped = normal + damping * np.eye(len(scale))
            trial = np.clip(
                values - np.linalg.solve(damped, slopes.T @ left / scale) / scale, *bounds
            )
            after = missed(trial)
            gained = float(left @ left - after @ after)
            damping *= 10
        if gained > 0:
            values, left, damping = trial, after, damping / 50
        if gained < _ENOUGH:
            break
    covariance = np.linalg.pinv(normal) / np.outer(scale, scale)
    return values, estimates(values, covariance, float(left @ left), freedom)
