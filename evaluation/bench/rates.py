# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rates with their confidence, and where they fall below a level."""

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any, TypedDict

import numpy as np

LEVEL = 0.8  # of identification: what is less counts as not read (paper §6.1)
_DRAWS = 400


class Rate(TypedDict):
    """A measured share, with the bounds of its 95 % confidence interval."""

    hits: int
    trials: int
    rate: float
    low: float
    high: float


def rate(hits: int, trials: int) -> Rate:
    """Return a share with its Wilson score interval (Wilson 1927); ValueError if it has none."""
    if not 0 <= hits <= trials or trials == 0:
        raise ValueError(f'{hits} hits in {trials} trials')
    z = 1.959964
    share = hits / trials
    centre = share + z * z / (2 * trials)
    spread = z * math.sqrt(share * (1 - share) / trials + z * z / (4 * trials * trials))
    scale = 1 + z * z / trials
    low, high = max(0.0, (centre - spread) / scale), min(1.0, (centre + spread) / scale)
    return Rate(hits=hits, trials=trials, rate=share, low=low, high=high)


def sum_of(rates: Iterable[Rate]) -> Rate:
    """Return the share of all trials of some rates."""
    hits, trials = np.sum([(one['hits'], one['trials']) for one in rates], axis=0).tolist()
    return rate(hits, trials)


class Frequency(TypedDict):
    """Events counted over a time, with the bounds of the 95 % confidence interval an hour."""

    events: int
    hours: float
    per_hour: float
    low: float
    high: float


def falls_below(level: float, places: Sequence[float], shares: Sequence[float]) -> float | None:
    """Return where a share, linear between its places, first falls below a level.

    None where it begins below the level, the last place where it stays above it.
    """
    if shares[0] < level:
        return None
    for (last, before), (place, after) in pairwise(zip(places, shares, strict=True)):
        if after < level:
            return last + (before - level) / (before - after) * (place - last)
    return float(places[-1])


def frequency(events: int, hours: float) -> Frequency:
    """Return events an hour with the exact interval of a Poisson count (Garwood 1936).

    Raises ValueError if the time is not positive, or the count is negative.
    """
    if events < 0 or not hours > 0:
        raise ValueError(f'{events} events in {hours} h')

    def mean_with(most: int, chance: float) -> float:
        """Return the mean of which no more than so many events have a chance."""
        low, high = 0.0, 10.0 + 2 * most + 10 * math.sqrt(most + 1)
        while high - low > 1e-9 * high:
            mean = (low + high) / 2
            terms = (
                math.exp(n * math.log(mean) - mean - math.lgamma(n + 1)) for n in range(most + 1)
            )
            low, high = (mean, high) if sum(terms) > chance else (low, mean)
        return high

    low = mean_with(events - 1, 0.975) / hours if events else 0.0
    high = mean_with(events, 0.025) / hours
    return Frequency(events=events, hours=hours, per_hour=events / hours, low=low, high=high)


class Crossing(TypedDict):
    """Where shares fall below a level, with the bounds of its 95 % confidence interval."""

    at: float | None  # None, as a bound, where it begins below the level
    low: float | None
    high: float | None


def crossing(level: float, places: Sequence[float], rates: Sequence[Rate]) -> Crossing:
    """Return where rates fall below a level; the last place where they stay above it.

    The bounds are those of shares that are redrawn with the binomial law.
    """
    trials = np.array([one['trials'] for one in rates])
    # None or all of some trials is not certain: half a trial is added to either.
    shares = (np.array([one['hits'] for one in rates]) + 0.5) / (trials + 1)
    redrawn = np.random.default_rng(0).binomial(trials, shares, (_DRAWS, len(trials))) / trials
    crossed = [falls_below(level, places, row) for row in redrawn.tolist()]
    known = [place for place in crossed if place is not None]
    at = falls_below(level, places, [one['rate'] for one in rates])
    # Where some begin below the level, so may the bound.
    first = [places[0] if place is None else place for place in crossed]
    low, high = (float(bound) for bound in np.percentile(first, (2.5, 97.5)))
    begun = len(known) / len(crossed)
    return Crossing(at=at, low=low if begun > 0.975 else None, high=high if begun > 0.025 else None)


def nearest(points: Iterable[dict[str, Any]], key: str, place: float) -> dict[str, Any]:
    """Return the point whose `key` is nearest to a place."""
    return min(points, key=lambda point: abs(float(point[key]) - place))
