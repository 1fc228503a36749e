# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A value with its uncertainty."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats

_NORMAL_95 = 1.96


class Estimate(NamedTuple):
    """A value with its standard deviation."""

    value: float
    stddev: float

    def times(self, factor: float) -> Estimate:
        """Return it in another unit."""
        return Estimate(self.value * factor, self.stddev * abs(factor))

    def text(self, unit: str = '') -> str:
        """Return value ± half of the interval that holds the truth in 95 of 100 cases."""
        half = _NORMAL_95 * self.stddev
        digits = 6 if half <= 0 else min(max(1 - _magnitude(half), 0), 6)
        return f'{self.value:.{digits}f} ± {half:.{digits}f}{" " if unit else ""}{unit}'


def _magnitude(number: float) -> int:
    return int(f'{number:e}'.split('e')[1])


def estimates(values: Floats, covariance: Floats, chi2: float, freedom: int) -> list[Estimate]:
    """Return values with standard deviations, raised by the reduced chi-square if above 1."""
    deviations = np.sqrt(np.diag(covariance) * max(chi2 / max(freedom, 1), 1.0))
    return [Estimate(*one) for one in zip(values.tolist(), deviations.tolist(), strict=True)]


def weighted_mean(values: Floats, stddev: Floats) -> Estimate:
    """Return the weighted mean of values (n,), with its uncertainty raised if they disagree."""
    weight = stddev**-2
    mean = float(weight @ values / weight.sum())
    excess = float(weight @ (values - mean) ** 2) / max(len(values) - 1, 1)
    return Estimate(mean, float(np.sqrt(max(excess, 1.0) / weight.sum())))
