# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Limits by bright walls, cover glasses and other sensors."""

import itertools
import math
from typing import Any

import numpy as np

from evaluation.bench.rates import LEVEL
from evaluation.bench.stresses import LABORATORY
from evaluation.experiments.stability import LIMITS, RANGES_M, named, read
from evaluation.report.chart_style import OTHERS, draw_shares, label, legend_below, new_chart

TITLE = 'Walls, glass and other sensors'
METHOD = 'joint'
UNIT = 'kcps/SPAD'
_LOOKS = [
    {'color': colour, 'linestyle': style, 'linewidth': width}
    for style in '-:'
    for colour, width in zip(OTHERS[1::2], (4, 1.5), strict=True)
]


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return what is read, by panel and condition."""
    seed, recordings = int(rng.integers(2**31)), 1 if quick else 4
    panels = []
    for panel in LABORATORY:
        points = [
            [
                {'place': value} | read(panel, index, where, seed, recordings, METHOD)
                for index, value in list(enumerate(panel.values))[:: 3 if quick else 1]
            ]
            for where in LIMITS
        ]
        panels.append({'title': panel.title, 'axis': panel.axis, 'points': points})
    return {'panels': panels}


def _breaks_at(points: list[dict[str, Any]]) -> float:
    """Return at what value fewer packets are read than four fifths; infinity: at none."""
    enough = LEVEL * points[0][METHOD]['right']['rate']
    for before, point in itertools.pairwise(points):
        if point[METHOD]['right']['rate'] < enough:
            return float(before['place'] + point['place']) / 2
    return math.inf


def limits(panel: dict[str, Any]) -> list[str]:
    """Return at what value of a panel fewer packets are read than four fifths, by condition."""
    found = []
    for points in panel['points']:
        at = _breaks_at(points)
        found.append(f'{at:.3g}' if math.isfinite(at) else f'>{points[-1]["place"]:g}')
    return found


def _message(figures: dict[str, Any]) -> str:
    near, far = (LIMITS.index((at, False)) for at in RANGES_M)
    worst = min(figures['panels'], key=lambda panel: _breaks_at(panel['points'][far]))

    def hides(index: int) -> str:
        at = _breaks_at(worst['points'][index])
        when = f'from {at:.3g} {UNIT} on' if math.isfinite(at) else 'never'
        return f'at {LIMITS[index][0]:g} m {when}'

    title = worst['title'].capitalize()
    return f'{title} is worst: it hides a lone marker {hides(far)}, {hides(near)}'


def draw(figures: dict[str, Any]) -> Any:
    """Draw what is read over the value of each panel."""
    panels = figures['panels']
    figure, axes = new_chart(len(panels), len(panels), 4.2, _message(figures))
    for axis, panel in zip(axes, panels, strict=True):
        for points, how in zip(panel['points'], _LOOKS, strict=True):
            shares = [point[METHOD]['right'] for point in points]
            draw_shares(axis, [point['place'] for point in points], shares, **how)
        y = 'markers read [%]' if axis is axes[0] else ''
        low, high = (panel['points'][0][index]['place'] for index in (1, -1))
        axis.set_xscale('symlog', linthresh=low)
        ticks = [10**power for power in range(5) if low <= 10**power <= high]
        x, title = f'{panel["axis"]} [{UNIT}]', panel['title']
        label(axis, x, y, title, percent=True, xlim=(0, high), xticks=ticks)
    conditions = {named(where): how for where, how in zip(LIMITS, _LOOKS, strict=True)}
    legend_below(figure, others=conditions)
    return figure
