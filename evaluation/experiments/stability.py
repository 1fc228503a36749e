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
from tqdm import tqdm

from evaluation.bench.judging import BOTH, read_shares
from evaluation.bench.panels import PANELS, Panel
from evaluation.bench.recordings import Sent, record, signal_at
from evaluation.bench.stresses import Stress
from evaluation.experiments.moving import across
from evaluation.report.charts import LEVEL, WRONG, draw_reads, legend_below, new_chart
from evaluation.report.claims import Table
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.reference import SENSOR

TITLE = 'Where methods break'
RANGES_M = (1.0, 2.0, 2.7)
"""Near, far, and where the reach of a lone packet ends."""
SPEED_M_S = 0.1
"""Of a marker that moves, across the view."""
REPEATED_S = 4.35
"""How long repeating markers are watched: three packets and a look."""
SHOWN_M = 2.0
_MOVING = replace(SENSOR, blur=0.05)
_RECORDINGS, _MOVERS = 2, 12
_QUICK_RECORDINGS, _QUICK_MOVERS = 1, 3
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

    def __init__(self, panel: Panel, where: tuple[float, bool, bool], seed: int, quick: bool):
        range_m, self.moves, self.repeats = where
        self._panel, self._range_m, self._seed = panel, range_m, seed
        movers, standing = (_QUICK_MOVERS, _QUICK_RECORDINGS) if quick else (_MOVERS, _RECORDINGS)
        self._recordings = movers if self.moves else standing

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
    chosen = PANELS[::5] if quick else PANELS
    conditions = CONDITIONS[:: 4 if quick else 1]
    harmless = {
        named(where): _Condition(PANELS[0], where, seed, quick).read(0, *METHODS)
        for where in conditions
    }
    panels = []
    for panel in tqdm(chosen, desc='stability', leave=False):
        breaks = {}
        for where in conditions:
            condition = _Condition(panel, where, seed, quick)
            usual = harmless[named(where)]
            breaks[named(where)] = {
                method: condition.breaks(method, usual[method]['right']['rate'])
                for method in METHODS
            }
        shown = _Condition(panel, (SHOWN_M, False, False), seed, quick)
        points = [
            {'place': value, **shown.read(index, *METHODS)}
            for index, value in enumerate(panel.values)
            if not quick or index % 3 == 0
        ]
        panels.append(
            {
                'name': panel.name,
                'title': panel.title,
                'axis': panel.axis,
                'breaks': breaks,
                'points': points,
            }
        )
    return {'harmless': harmless, 'panels': panels, 'speed_m_s': SPEED_M_S}


def told(found: dict[str, Any]) -> str:
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
        cells = [
            '/'.join(
                told(panel['breaks'][name][method])
                for name in conditions
                if name.partition(', ')[2] == kind
            )
            for kind in kinds
            for method in METHODS
        ]
        rows.append([f'{panel["title"]}, {panel["axis"]}', *cells])
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw a panel for every stress."""
    columns = 4
    rows = -(-len(figures['panels']) // columns)
    figure, axes = new_chart(
        rows,
        columns,
        16,
        3.6 * rows + 1.2,
        f"Lone packets at {SHOWN_M:g} m: no stress breaks the default before the paper's method",
    )
    for axis in axes.flat[len(figures['panels']) :]:
        axis.set_visible(False)
    for index, (axis, panel) in enumerate(zip(axes.flat, figures['panels'], strict=False)):
        draw_reads(axis, panel['points'])
        axis.set_title(panel['title'], fontsize=13)
        axis.set_xlabel(panel['axis'])
        if panel['points'][0]['place'] > panel['points'][-1]['place']:
            axis.invert_xaxis()
        if index % columns == 0:
            axis.set_ylabel('markers [%]')
    legend_below(figure, METHODS, WRONG)
    return figure
