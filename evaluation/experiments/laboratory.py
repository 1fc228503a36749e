# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What stands and shines in laboratories: bright walls, cover glasses, other sensors."""

import itertools
from typing import Any

import numpy as np

from evaluation.bench.stresses import LABORATORY
from evaluation.experiments.stability import RANGES_M, named, read
from evaluation.report.chart_style import LEVEL, OTHERS, draw_shares, label, legend_below, new_chart
from evaluation.report.claims import Table

TITLE = 'Walls, glass and other sensors'
MESSAGE = 'What is harmless beside a near marker hides one at the limit of the reach'
METHOD = 'joint'
UNIT = 'kcps/SPAD'
CONDITIONS = list(itertools.product((RANGES_M[0], RANGES_M[-1]), (False,), (False, True)))
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
            for where in CONDITIONS
        ]
        panels.append({'title': panel.title, 'axis': panel.axis, 'points': points})
    return {'panels': panels}


def limits(panel: dict[str, Any]) -> list[str]:
    """Return at what value of a panel fewer packets are read than four fifths, by condition."""
    found = []
    for points in panel['points']:
        shares = [point[METHOD]['right']['rate'] for point in points]
        few = [share < LEVEL * shares[0] for share in shares]
        places = [point['place'] for point in points]
        if any(few):
            first = few.index(True)
            found.append(f'{(places[first - 1] + places[first]) / 2:.3g} {UNIT}')
        else:
            found.append(f'>{places[-1]:g} {UNIT}')
    return found


def table(figures: dict[str, Any]) -> Table:
    """Return where reading breaks, near and far, of lone and of repeating markers."""
    rows = [['breaks at', *(named(where) for where in CONDITIONS)]]
    return rows + [
        [f'{panel["title"]}, {panel["axis"]}', *limits(panel)] for panel in figures['panels']
    ]


def draw(figures: dict[str, Any]) -> Any:
    """Draw what is read over the value of each panel."""
    panels = figures['panels']
    figure, axes = new_chart(len(panels), len(panels), 4.2, MESSAGE)
    for axis, panel in zip(axes, panels, strict=True):
        for points, how in zip(panel['points'], _LOOKS, strict=True):
            shares = [point[METHOD]['right'] for point in points]
            draw_shares(axis, [point['place'] for point in points], shares, **how)
        y = 'markers read [%]' if axis is axes[0] else ''
        label(axis, f'{panel["axis"]} [{UNIT}]', y, panel['title'], percent=True)
        axis.set_xscale('symlog', linthresh=panel['points'][0][1]['place'])
        axis.set_xlim(0, panel['points'][0][-1]['place'])
    conditions = {named(where): how for where, how in zip(CONDITIONS, _LOOKS, strict=True)}
    legend_below(figure, others=conditions)
    return figure
