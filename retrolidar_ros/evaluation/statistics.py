# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rates with their confidence."""

from __future__ import annotations

import math
from typing import TypedDict


class Rate(TypedDict):
    """A measured share, with the bounds of its 95 % confidence interval."""

    hits: int
    trials: int
    rate: float
    low: float
    high: float


def rate(hits: int, trials: int) -> Rate:
    """Return a share with its Wilson score interval (Wilson 1927).

    Raises
    ------
    ValueError
        If there were no trials, or more hits than trials.
    """
    if not 0 <= hits <= trials or trials == 0:
        raise ValueError(f'{hits} hits in {trials} trials')
    z = 1.959964
    share = hits / trials
    centre = share + z * z / (2 * trials)
    spread = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    return Rate(
        hits=hits,
        trials=trials,
        rate=share,
        low=max(0.0, (centre - spread) / scale),
        high=min(1.0, (centre + spread) / scale),
    )
