# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sweeps of both methods: distance, angle, size, yaw, light, packets.

All of them follow the paper's way: lone packets, and four of five identified count as read.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench.judging import BOTH, Options, judge_all, read_of
from evaluation.bench.rates import LEVEL, crossing, nearest
from evaluation.bench.recordings import Sent, rng_at
from evaluation.report.chart_style import WRONG, draw_reads, label, legend_below, line, new_chart
from evaluation.report.claims import Claims
from retrolidar_ros.detector import METHODS

MAX_BITS = 4  # so many wrong bits or more are counted together
PAPERS_OWN = {"80 % of the paper's own": line(':')}  # entry of a legend


@dataclass(frozen=True)
class Curve:
    """One panel: places, and what makes a recording at each."""

    name: str
    make: Callable[[float, np.random.Generator], Sent]
    places: Sequence[float]
    recordings: int = 3  # of sixteen markers, or of one
    variants: Mapping[str, Options] = field(default_factory=lambda: BOTH)
    lone: bool = True


def _point(curve: Curve, place: float, recordings: int, seed: int) -> dict[str, Any]:
    make, rng = partial(curve.make, place), rng_at(seed, place)
    found = judge_all(make, recordings, rng, curve.variants, lone=curve.lone)
    point: dict[str, Any] = {'place': place}
    for name, rows in found.items():
        bits = [min(one.corrected_bits, MAX_BITS) for row in rows for one in row.own]
        markers = sum(len(row.right) for row in rows)
        point[name] = {
            **read_of(rows),
            'bits': np.bincount(np.array(bits, dtype=int), minlength=MAX_BITS + 1).tolist(),
            'found': sum(min(row.candidates, len(row.right)) for row in rows) / markers,
        }
    return point


def ends_of(points: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Return to where four of five are read, by name."""
    places = [point['place'] for point in points]
    return {
        name: crossing(LEVEL, places, [point[name]['right'] for point in points]) for name in names
    }


@dataclass
class Sweep:
    """An experiment of some curves."""

    TITLE: str
    message: Callable[[dict[str, Any]], str]  # of the chart, by its figures
    axis: str
    curves: Sequence[Curve]
    claims: Callable[[dict[str, Any]], Claims]
    marks: Mapping[str, float] = field(default_factory=dict)  # the paper's own places, by curve

    def run(self, rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
        """Return shares of markers that are read, and to where four of five are, by curve."""
        seed, curves = int(rng.integers(2**31)), {}
        for curve in self.curves:
            places = curve.places[:: max(1, len(curve.places) // 3)] if quick else curve.places
            recordings = max(1, curve.recordings // 8) if quick else curve.recordings
            points = [_point(curve, place, recordings, seed) for place in places]
            curves[curve.name] = {'points': points, 'ends': ends_of(points, list(curve.variants))}
        return {'curves': curves}

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw a panel for each curve."""
        curves, count = figures['curves'].items(), len(figures['curves'])
        columns = 2 if count == 4 else min(3, count)
        height = (4.6 if count == 1 else 3.2) * -(-count // columns) + 1
        figure, panels = new_chart(count, columns, height, self.message(figures))
        for axis, (name, curve) in zip(panels, curves, strict=True):
            draw_reads(axis, curve['points'])
            if name in self.marks:
                axis.axvline(self.marks[name], **line(':'), linewidth=1.2)
            y = 'markers [%]' if axis in panels[::columns] else ''
            label(axis, self.axis, y, name, percent=True)
        legend_below(figure, METHODS, WRONG | (PAPERS_OWN if self.marks else {}))
        return figure


def end_of(figures: Mapping[str, Any], curve: str, method: str) -> float | None:
    """Return to where four of five are read."""
    at: float | None = figures['curves'][curve]['ends'][method]['at']
    return at


def point_of(figures: Mapping[str, Any], curve: str, place: float) -> dict[str, Any]:
    """Return the point that is nearest to a place."""
    return nearest(figures['curves'][curve]['points'], 'place', place)
