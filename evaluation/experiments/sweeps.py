# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""One thing varied, and what both methods read of it: distance, angle, size, yaw, light, packets.

All of them follow the paper's way: lone packets, and four of five identified count as read.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from evaluation.bench.judging import BOTH, Options, judged, read_of
from evaluation.bench.rates import crossing
from evaluation.bench.recordings import Sent
from evaluation.report.charts import LEVEL, WRONG, draw_reads, legend_below, new_chart
from evaluation.report.claims import Claims, Table, end_as_text
from retrolidar_ros.detector import METHODS

MOST_BITS = 4
"""So many wrong bits or more are counted together."""


@dataclass(frozen=True)
class Curve:
    """One panel: places, and what makes a recording at each."""

    name: str
    make: Callable[[float, np.random.Generator], Sent]
    places: Sequence[float]
    recordings: int = 3
    """Of sixteen markers, or of one."""
    variants: Mapping[str, Options] = field(default_factory=lambda: BOTH)
    lone: bool = True


def _point(curve: Curve, place: float, recordings: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what is read at a place."""
    found: dict[str, list[Any]] = {name: [] for name in curve.variants}
    for _ in range(recordings):
        sent = curve.make(place, rng)
        for name, options in curve.variants.items():
            found[name].append(judged(sent, options, lone=curve.lone))
    point: dict[str, Any] = {'place': place}
    for name, rows in found.items():
        bits = [min(one.corrected_bits, MOST_BITS) for row in rows for one in row.own]
        point[name] = {
            **read_of(rows),
            'bits': np.bincount(np.array(bits, dtype=int), minlength=MOST_BITS + 1).tolist(),
            'found': sum(min(row.candidates, len(row.right)) for row in rows)
            / sum(len(row.right) for row in rows),
        }
    return point


class Sweep:
    """An experiment of some curves: what its chart says, over which axis, with which unit.

    `marks` are the paper's own places by the names of curves.
    """

    def __init__(
        self,
        title: str,
        message: str,
        axis: str,
        unit: str,
        curves: Sequence[Curve],
        claims: Callable[[dict[str, Any]], Claims],
        marks: Mapping[str, float],
    ) -> None:
        self.TITLE = title
        self.curves = curves
        self.claims = claims
        self._message, self._axis, self._unit, self._marks = message, axis, unit, marks

    def run(self, rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
        """Return shares of markers that are read, and to where four of five are, by curve."""
        curves = {}
        for curve in self.curves:
            places = curve.places[:: max(1, len(curve.places) // 3)] if quick else curve.places
            recordings = max(1, curve.recordings // 8) if quick else curve.recordings
            points = [_point(curve, place, recordings, rng) for place in places]
            ends = {
                name: crossing(
                    LEVEL,
                    [point['place'] for point in points],
                    [point[name]['right'] for point in points],
                )
                for name in curve.variants
            }
            curves[curve.name] = {'points': points, 'ends': ends}
        return {'curves': curves}

    def table(self, figures: dict[str, Any]) -> Table:
        """Return to where four of five are read, and the most wrong IDs on the way."""
        rows = [
            [
                '80 % are read to',
                *METHODS,
                *(f'most wrong IDs, {name}' for name in METHODS),
            ]
        ]
        for name, curve in figures['curves'].items():
            rows.append(
                [
                    name,
                    *(end_as_text(curve['ends'][method], self._unit) for method in METHODS),
                    *(
                        f'{max(point[method]["wrong"]["rate"] for point in curve["points"]):.0%}'
                        for method in METHODS
                    ),
                ]
            )
        return rows

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw a panel for each curve."""
        columns = 2 if len(figures['curves']) == 4 else min(3, len(figures['curves']))
        rows = -(-len(figures['curves']) // columns)
        figure, axes = new_chart(rows, columns, 4.7 * columns + 0.5, 4.2 * rows + 1, self._message)
        for axis in axes.flat[len(figures['curves']) :]:
            axis.set_visible(False)
        for axis, (name, curve) in zip(axes.flat, figures['curves'].items(), strict=False):
            draw_reads(axis, curve['points'])
            if name in self._marks:
                axis.axvline(self._marks[name], color='0.2', linewidth=1.2, linestyle=':')
            axis.set_title(name, fontsize=12)
            axis.set_xlabel(self._axis)
        for row in axes:
            row[0].set_ylabel('markers [%]')
        others = dict(WRONG)
        if self._marks:
            others["80 % of the paper's own"] = {'color': '0.2', 'linestyle': ':'}
        legend_below(figure, METHODS, others)
        return figure


def end_of(figures: Mapping[str, Any], curve: str, method: str) -> float | None:
    """Return to where four of five are read."""
    at: float | None = figures['curves'][curve]['ends'][method]['at']
    return at


def point_of(figures: Mapping[str, Any], curve: str, place: float) -> dict[str, Any]:
    """Return the point that is nearest to a place."""
    points: list[dict[str, Any]] = figures['curves'][curve]['points']
    return min(points, key=lambda point: abs(float(point['place']) - place))
