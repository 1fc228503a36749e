# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The same trials for the default and for the paper's method, and how far they read."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypedDict

import numpy as np

from evaluation.bench.link import Trial, outcome
from evaluation.bench.rates import Rate, falls_below, rate
from evaluation.report.charts import LEVEL, draw_shares, look
from evaluation.report.claims import NOTHING
from retrolidar_ros.detector import METHODS, create_detector

WAKING_S = (2.0, 2.5)
"""When lone packets begin."""


class Read(TypedDict):
    """What share of the markers was read rightly, and of what share a wrong ID was read."""

    right: Rate
    wrong: Rate


def read_shares(
    make: Callable[[np.random.Generator], Trial],
    scenes: int,
    rng: np.random.Generator,
    *,
    max_packets: int = 8,
) -> dict[str, Read]:
    """Play the same scenes to both methods.

    Parameters
    ----------
    make : callable
        Makes a trial; its scene has a marker in every zone.
    scenes : int
        How many trials.
    rng : numpy.random.Generator
    max_packets : int
        How many packets the default method may combine.
    """
    counts = np.zeros((len(METHODS), 3), dtype=int)
    for _ in range(scenes):
        trial = make(rng)
        for row, method in enumerate(METHODS):
            detector = create_detector(method, trial.recording.grid, max_packets=max_packets)
            came = outcome(trial, detector)
            counts[row] += came.right.sum(), came.wrong.sum(), len(came.right)
    return {
        method: Read(right=rate(right, trials), wrong=rate(wrong, trials))
        for method, (right, wrong, trials) in zip(METHODS, counts.tolist(), strict=True)
    }


def reach(method: str, points: Sequence[dict[str, Any]], place: str = 'range_m') -> float | None:
    """Return how far four of five are read, of points with what `read_shares` returns.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    points : sequence of dict
        In the order of their places.
    place : str
        The key of a point's place.

    Returns
    -------
    float or None
        The last place where all are read; None where less than four of five are at the first.
    """
    places = [point[place] for point in points]
    shares = [point[method]['right']['rate'] for point in points]
    if min(shares) >= LEVEL:
        return float(places[-1])
    return falls_below(LEVEL, places, shares)


def told(value: float | None, unit: str = 'm', digits: int = 2) -> str:
    """Return a value with its unit as text."""
    return NOTHING if value is None else f'{value:.{digits}f} {unit}'


def most_wrong(method: str, points: Sequence[dict[str, Any]]) -> float:
    """Return the largest share of wrong IDs of a method."""
    return max(float(point[method]['wrong']['rate']) for point in points)


def draw_reads(
    axes: Any, points: Sequence[dict[str, Any]], place: str, *, wrong: bool = True
) -> None:
    """Draw right and, dashed, wrong shares of both methods over a place."""
    places = [point[place] for point in points]
    for method in METHODS:
        draw_shares(
            axes, places, [point[method]['right'] for point in points], label=method, **look(method)
        )
        if wrong:
            shares = [100 * point[method]['wrong']['rate'] for point in points]
            how = {**look(method), 'marker': ''}
            axes.plot(places, shares, linestyle='--', label=f'{method}, wrong ID', **how)
    axes.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
    axes.set_ylim(-2, 103)
    axes.set_ylabel('markers [%]')
