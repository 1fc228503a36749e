# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits: one stress after the other, near and far, lone and repeating; of both methods at 2 m.

A stress breaks a method where it reads less than four fifths of what the same method reads
without the stress. It is found by bisection.
"""

import itertools
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench.judging import BOTH, judge_all, read_of
from evaluation.bench.rates import LEVEL
from evaluation.bench.recordings import record_at
from evaluation.bench.stresses import PANELS, Panel
from evaluation.report.chart_style import WRONG, draw_reads, label, legend_below, look, new_chart
from evaluation.report.claims import three_digits
from retrolidar_ros.detector import METHODS

TITLE = 'Where methods break'
RANGES_M = (1.0, 2.7)  # near, and where the reach of a lone packet ends
REPEATED_S = 4.35  # how long repeating markers are watched: three packets and a look
_COLUMNS = 3
_MANY = 50  # times the first stress is the last one of a logarithmic panel
_MIN_READ = 0.25  # a method that reads less without any stress has no limit

Where = tuple[float, bool]  # range [m], and whether the marker repeats
SHOWN: Where = (2.0, False)
LIMITS: list[Where] = list(itertools.product(RANGES_M, (False, True)))
CONDITIONS = [SHOWN, *LIMITS]


def read(
    panel: Panel, index: int, where: Where, seed: int, recordings: int, *names: str
) -> dict[str, Any]:
    """Return what methods read at a value of a panel under a condition."""
    range_m, repeats = where
    stress, repeated_s = panel.stress(panel.values[index]), REPEATED_S if repeats else None
    make = partial(record_at, range_m, stress=stress, repeated_s=repeated_s)
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
    range_m, repeats = where
    return f'{range_m:g} m, standing, {"repeating" if repeats else "lone"}'


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return breaking points by condition, and the panels of one in full, there of both methods."""
    seed, conditions = int(rng.integers(2**31)), CONDITIONS[:: 4 if quick else 1]
    recordings = 1 if quick else 4
    harmless = {
        where: read(PANELS[0], 0, where, seed, recordings, *METHODS) for where in conditions
    }
    panels = []
    for panel in PANELS[:: 5 if quick else 1]:
        breaks: dict[str, dict[str, Any]] = {named(where): {} for where in conditions}
        for where, method in itertools.product(conditions, METHODS):
            if where == SHOWN or method == 'joint':
                enough = LEVEL * harmless[where][method]['right']['rate']
                found = _breaks(panel, where, seed, recordings, method, enough)
                breaks[named(where)][method] = found
        points = [
            {'place': panel.values[index]} | read(panel, index, SHOWN, seed, recordings, *METHODS)
            for index in range(0, len(panel.values), 3 if quick else 1)
        ]
        about = {'name': panel.name, 'title': panel.title, 'axis': panel.axis}
        panels.append(about | {'breaks': breaks, 'points': points})
    return {'panels': panels}


def breaking_point(found: dict[str, Any]) -> str:
    """Return a breaking point as text."""
    if found['state'] == 'not read':
        return '×'
    return f'{">" if found["state"] == "never" else ""}{three_digits(found["at"])}'


def _tolerated(panel: dict[str, Any], method: str) -> float:
    """Return what share of the largest stress that was tried a method tolerates."""
    found = panel['breaks'][named(SHOWN)][method]
    first, last = (panel['points'][end]['place'] for end in (0, -1))
    return 0.0 if found['state'] == 'not read' else (found['at'] - first) / (last - first)


def _falls(panel: dict[str, Any]) -> bool:
    """Return whether lower values stress more."""
    return bool(panel['points'][0]['place'] > panel['points'][-1]['place'])


def draw(figures: dict[str, Any]) -> Any:
    """Draw a pair of bars for every stress: how much of it both methods tolerate."""
    panels = sorted(figures['panels'], key=lambda panel: _tolerated(panel, 'joint'))
    better = sum(_tolerated(panel, 'joint') > _tolerated(panel, 'paper') for panel in panels)
    count = len(panels)
    title = f"The default tolerates {better} of {count} stresses better than the paper's method"
    figure, (axis,) = new_chart(1, 1, 1.6 + 0.46 * count, title)
    places = np.arange(count)
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
        second, last = (panel['points'][index]['place'] for index in (1, -1))
        how: dict[str, Any] = {}
        if last > _MANY * second:
            axis.set_xscale('symlog', linthresh=second)
            ticks = [0, *(10**n for n in range(1, 4) if 10**n < last)]
            how = {'xlim': (-second / 3, 1.3 * last), 'xticks': ticks}
        label(axis, panel['axis'], y, panel['title'], percent=True, **how)
        if _falls(panel):
            axis.invert_xaxis()
    legend_below(figure, METHODS, WRONG)
    return figure
