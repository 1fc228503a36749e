# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where both methods break: one stress after the other, near, far, standing, moving.

A stress breaks a method where it reads less than four fifths of what the same method reads
without the stress. It is sought by halving, so only about the breaking point many are tried.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.judging import BOTH, read_shares
from evaluation.bench.recordings import Sent, record, signal_at
from evaluation.bench.stresses import PANELS, Panel, Stress
from evaluation.experiments.moving import across
from evaluation.report.charts import LEVEL, WRONG, draw_reads, label, legend_below, new_chart
from evaluation.report.claims import Table
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.reference import SENSOR

TITLE = 'Where methods break'
MESSAGE = "Lone packets at 2 m: no stress breaks the default before the paper's method"
RANGES_M = (1.0, 2.0, 2.7)  # near, far, and where the reach of a lone packet ends
SPEED_M_S = 0.1  # of a marker that moves, across the view
REPEATED_S = 4.35  # how long repeating markers are watched: three packets and a look
SHOWN_M = 2.0
_COLUMNS = 4
_MOVING = replace(SENSOR, blur=0.05)
_LEAST = 0.25  # less than this without any stress is nothing to break


def trial(
    stress: Stress, range_m: float, moves: bool, repeats: bool, rng: np.random.Generator
) -> Sent:
    """Return a recording under a stress."""
    how: dict[str, Any] = {'repeated_s': REPEATED_S if repeats else None, 'range_m': range_m}
    if moves:
        how |= {'path': across(SPEED_M_S, range_m, rng), 'sensor': _MOVING}
    return record(stress, signal_at(range_m), rng, USABLE_IDS, **how)


class _Condition:
    """What is read of one panel's values under one condition, each recording made once."""

    def __init__(
        self, panel: Panel, where: tuple[float, bool, bool], seed: int, recordings: tuple[int, int]
    ) -> None:
        range_m, self.moves, self.repeats = where
        self._panel, self._range_m, self._seed = panel, range_m, seed
        self._recordings = recordings[self.moves]

    def read(self, index: int, *names: str) -> dict[str, Any]:
        """Return what methods read at a value."""
        stress = self._panel.stress(self._panel.values[index])
        rng = np.random.default_rng([self._seed, index])
        return read_shares(
            lambda rng: trial(stress, self._range_m, self.moves, self.repeats, rng),
            self._recordings,
            rng,
            {name: BOTH[name] for name in names},
            lone=not self.repeats,
        )

    def breaks(self, method: str, harmless: float) -> dict[str, Any]:
        """Return between which values a method breaks, and the most wrong IDs on the way."""
        if harmless < _LEAST:
            return {'state': 'not read'}
        low, high, wrong = 0, len(self._panel.values), 0.0
        while high - low > 1:
            middle = (low + high) // 2
            found = self.read(middle, method)[method]
            wrong = max(wrong, found['wrong']['rate'])
            low, high = (
                (middle, high) if found['right']['rate'] >= LEVEL * harmless else (low, middle)
            )
        values = self._panel.values
        if high == len(values):
            return {'state': 'never', 'at': values[-1], 'wrong': wrong}
        return {'state': 'breaks', 'at': (values[low] + values[high]) / 2, 'wrong': wrong}


CONDITIONS = [
    (range_m, moves, repeats)
    for range_m in RANGES_M
    for moves in (False, True)
    for repeats in (False, True)
]


def named(where: tuple[float, bool, bool]) -> str:
    """Return the name of a condition: range, whether the marker moves, whether it repeats."""
    range_m, moves, repeats = where
    return (
        f'{range_m:g} m, {"moving" if moves else "standing"}, {"repeating" if repeats else "lone"}'
    )


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return breaking points under all conditions, and the panels of one in full."""
    seed = int(rng.integers(2**31))
    conditions = CONDITIONS[:: 4 if quick else 1]

    recordings = (1, 3) if quick else (1, 5)  # of those that stand, and of those that move

    def condition(panel: Panel, where: tuple[float, bool, bool]) -> _Condition:
        return _Condition(panel, where, seed, recordings)

    harmless = {named(where): condition(PANELS[0], where).read(0, *METHODS) for where in conditions}
    panels = []
    for panel in PANELS[:: 5 if quick else 1]:
        breaks = {
            named(where): {
                method: condition(panel, where).breaks(method, read['right']['rate'])
                for method, read in harmless[named(where)].items()
            }
            for where in conditions
        }
        shown = _Condition(panel, (SHOWN_M, False, False), seed, (1 if quick else 2, 0))
        points = [
            {'place': value, **shown.read(index, *METHODS)}
            for index, value in enumerate(panel.values)
            if not quick or index % 3 == 0
        ]
        about = {'name': panel.name, 'title': panel.title, 'axis': panel.axis}
        panels.append(about | {'breaks': breaks, 'points': points})
    return {'harmless': harmless, 'panels': panels}


def breaking_point(found: dict[str, Any]) -> str:
    """Return a breaking point as text."""
    if found['state'] == 'not read':
        return '×'
    return f'{">" if found["state"] == "never" else ""}{found["at"]:.3g}'


def table(figures: dict[str, Any]) -> Table:
    """Return where each method breaks: near, far and at the end of the reach."""
    conditions = list(figures['harmless'])
    kinds = list(dict.fromkeys(name.partition(', ')[2] for name in conditions))
    rows = [['breaks at', *(f'{method}: {kind}' for kind in kinds for method in METHODS)]]
    for panel in figures['panels']:
        row = [f'{panel["title"]}, {panel["axis"]}']
        for kind in kinds:
            names = [name for name in conditions if name.partition(', ')[2] == kind]
            row += [
                '/'.join(breaking_point(panel['breaks'][name][method]) for name in names)
                for method in METHODS
            ]
        rows.append(row)
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw a panel for every stress."""
    rows = -(-len(figures['panels']) // _COLUMNS)
    figure, axes = new_chart(rows, _COLUMNS, 16, 3.6 * rows + 1.2, MESSAGE)
    for axis in axes[len(figures['panels']) :]:
        axis.set_visible(False)
    for axis, panel in zip(axes, figures['panels'], strict=False):
        draw_reads(axis, panel['points'])
        y = 'markers [%]' if axis in axes[::_COLUMNS] else ''
        label(axis, panel['axis'], y, panel['title'], percent=True)
        if panel['points'][0]['place'] > panel['points'][-1]['place']:
            axis.invert_xaxis()
    legend_below(figure, METHODS, WRONG)
    return figure
