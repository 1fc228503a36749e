# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits of both methods: one stress after the other, near, far, standing, moving.

A stress breaks a method where it reads less than four fifths of what the same method reads
without the stress. It is found by bisection.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from evaluation.bench.judging import BOTH, judge_all, read_of
from evaluation.bench.rates import LEVEL
from evaluation.bench.recordings import Sent, record, signal_at
from evaluation.bench.stresses import PANELS, Panel
from evaluation.experiments.moving import across
from evaluation.report.chart_style import WRONG, draw_reads, label, legend_below, look, new_chart
from retrolidar_ros.detector import METHODS

TITLE = 'Where methods break'
RANGES_M = (1.0, 2.0, 2.7)  # near, far, and where the reach of a lone packet ends
SPEED_M_S = 0.1  # of a marker that moves, across the view
REPEATED_S = 4.35  # how long repeating markers are watched: three packets and a look
_COLUMNS = 3
_MIN_READ = 0.25  # a method that reads less without any stress has no limit

Where = tuple[float, bool, bool]  # range [m], whether the marker moves, whether it repeats
SHOWN: Where = (2.0, False, False)
CONDITIONS = list(itertools.product(RANGES_M, (False, True), (False, True)))


def read(
    panel: Panel, index: int, where: Where, seed: int, recordings: int, *names: str
) -> dict[str, Any]:
    """Return what methods read at a value of a panel under a condition."""
    range_m, moves, repeats = where
    stress = panel.stress(panel.values[index])
    how: dict[str, Any] = {'range_m': range_m, 'repeated_s': REPEATED_S if repeats else None}

    def make(rng: np.random.Generator) -> Sent:
        path = across(SPEED_M_S, range_m, rng) if moves else None
        return record(stress, signal_at(range_m), rng, path=path, **how)

    rng, variants = np.random.default_rng([seed, index]), {name: BOTH[name] for name in names}
    found = judge_all(make, recordings, rng, variants, lone=not repeats)
    return {name: read_of(rows) for name, rows in found.items()}


def _breaks(
    panel: Panel, where: Where, seed: int, recordings: int, method: str, enough: float
) -> dict[str, Any]:
    """Return the value at which a method begins to read less than a share."""
    if enough < LEVEL * _MIN_READ:
        return {'state': 'not read'}
    values, low, high = panel.values, 0, len(panel.values)
    while high - low > 1:
        middle = (low + high) // 2
        found = read(panel, middle, where, seed, recordings, method)[method]['right']['rate']
        low, high = (middle, high) if found >= enough else (low, middle)
    if high == len(values):
        return {'state': 'never', 'at': values[-1]}
    return {'state': 'breaks', 'at': (values[low] + values[high]) / 2}


def named(where: Where) -> str:
    """Return the name of a condition."""
    range_m, moves, repeats = where
    how = f'{"moving" if moves else "standing"}, {"repeating" if repeats else "lone"}'
    return f'{range_m:g} m, {how}'


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return breaking points under all conditions, and the panels of one in full."""
    seed, conditions = int(rng.integers(2**31)), CONDITIONS[:: 4 if quick else 1]
    recordings = (1, 2) if quick else (1, 4)  # of those that stand, and of those that move
    harmless = {
        where: read(PANELS[0], 0, where, seed, recordings[where[1]], *METHODS)
        for where in conditions
    }
    panels = []
    for panel in PANELS[:: 5 if quick else 1]:
        breaks: dict[str, dict[str, Any]] = {named(where): {} for where in conditions}
        for where, method in itertools.product(conditions, METHODS):
            enough = LEVEL * harmless[where][method]['right']['rate']
            found = _breaks(panel, where, seed, recordings[where[1]], method, enough)
            breaks[named(where)][method] = found
        points = [
            {'place': panel.values[index]}
            | read(panel, index, SHOWN, seed, 1 if quick else 2, *METHODS)
            for index in range(0, len(panel.values), 3 if quick else 1)
        ]
        about = {'name': panel.name, 'title': panel.title, 'axis': panel.axis}
        panels.append(about | {'breaks': breaks, 'points': points})
    return {'harmless': {named(where): own for where, own in harmless.items()}, 'panels': panels}


def breaking_point(found: dict[str, Any]) -> str:
    """Return a breaking point as text."""
    if found['state'] == 'not read':
        return '×'
    return f'{">" if found["state"] == "never" else ""}{found["at"]:.3g}'


def _tolerated(panel: dict[str, Any], method: str) -> float:
    """Return what share of the largest stress that was tried a method tolerates."""
    found = panel['breaks'][named(SHOWN)][method]
    first, last = (panel['points'][end]['place'] for end in (0, -1))
    return 0.0 if found['state'] == 'not read' else (found['at'] - first) / (last - first)


def _falls(panel: dict[str, Any]) -> bool:
    """Return whether lower values stress more."""
    return bool(panel['points'][0]['place'] > panel['points'][-1]['place'])


def _message(panels: Sequence[dict[str, Any]]) -> str:
    better = sum(_tolerated(panel, 'joint') > _tolerated(panel, 'paper') for panel in panels)
    return (
        f"The default tolerates {better} of {len(panels)} stresses better than the paper's method"
    )


def draw(figures: dict[str, Any]) -> Any:
    """Draw a pair of bars for every stress: how much of it both methods tolerate."""
    panels = [panel for panel in figures['panels'] if named(SHOWN) in panel['breaks']]
    panels.sort(key=lambda panel: _tolerated(panel, 'joint'))
    figure, (axis,) = new_chart(1, 1, 1.6 + 0.46 * len(panels), _message(panels))
    places = np.arange(len(panels))
    for method, shift in zip(METHODS, (0.2, -0.2), strict=True):
        shares = [100 * _tolerated(panel, method) for panel in panels]
        axis.barh(places + shift, shares, 0.38, color=look(method)['color'])
        for place, share, panel in zip(places, shares, panels, strict=True):
            words = breaking_point(panel['breaks'][named(SHOWN)][method])
            unit = panel['axis'].partition('[')[2].replace(']', '')
            down = 'down to ' if _falls(panel) else ''
            axis.text(share + 1, place + shift, f'{down}{words} {unit}', fontsize=9, va='center')
    axis.set_yticks(places, [panel['title'] for panel in panels])
    axis.grid(axis='y', visible=False)
    x = 'stress at which a fifth fewer packets are read,\nas a share of the largest tried [%]'
    label(axis, x, '', 'lone packets at 2 m', xlim=(0, 112))
    legend_below(figure, METHODS)
    return figure


def draw_panels(figures: dict[str, Any]) -> Any:
    """Draw what is read over every stress, a panel for each."""
    count, title = len(figures['panels']), 'Lone packets at 2 m, one stress after the other'
    figure, axes = new_chart(count, _COLUMNS, 2.7 * -(-count // _COLUMNS) + 1.2, title)
    for axis, panel in zip(axes, figures['panels'], strict=True):
        draw_reads(axis, panel['points'])
        y = 'markers [%]' if axis in axes[::_COLUMNS] else ''
        label(axis, panel['axis'], y, panel['title'], percent=True)
        if _falls(panel):
            axis.invert_xaxis()
    legend_below(figure, METHODS, WRONG)
    return figure
