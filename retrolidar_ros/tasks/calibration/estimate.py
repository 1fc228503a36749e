# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A number and how sure it is."""

from __future__ import annotations

from typing import NamedTuple

_NORMAL_95 = 1.96


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

    @property
    def interval(self) -> tuple[float, float]:
        """The truth is between these in 95 of 100 cases."""
        half = _NORMAL_95 * self.stddev
        return self.value - half, self.value + half

    def text(self, unit: str = '') -> str:
        """Return value ± half of the interval that holds the truth in 95 of 100 cases."""
        half = _NORMAL_95 * self.stddev
        digits = 6 if half <= 0 else min(max(1 - _magnitude(half), 0), 6)
        return f'{self.value:.{digits}f} ± {half:.{digits}f}{" " if unit else ""}{unit}'


def _magnitude(number: float) -> int:
    return int(f'{number:e}'.split('e')[1])
