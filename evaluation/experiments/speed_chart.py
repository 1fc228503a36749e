# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The chart of the experiment `speed-accuracy`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from evaluation.report.charts import look, new_chart
from retrolidar_ros.scene.truth import PACKET_S

MESSAGE = "LiDAR: at the same reach a hundredth of a tag's computing; AprilTag: an answer at once"
_MOST_WRONG = 0.2  # where the colour of wrong IDs ends


def _frontier(points: Sequence[dict[str, Any]]) -> list[tuple[float, float]]:
    """Return the points than which none is cheaper and reads farther, as steps."""
    steps: list[tuple[float, float]] = []
    for point in sorted(points, key=lambda one: float(one['cpu_ms'])):
        reach_m = point['reach_m']['at'] or 0.0
        if not steps or reach_m > steps[-1][1]:
            if steps:
                steps.append((point['cpu_ms'], steps[-1][1]))
            steps.append((point['cpu_ms'], reach_m))
    return steps


_NAMES = {
    'joint: packets combined': ('-', 'default: 1 to 8 packets combined'),
    'joint: IDs registered': ('--', 'default: 1000 to 16 IDs registered'),
    'joint: false IDs allowed an hour': (':', 'default: 0.001 to 1000 false IDs an hour'),
    'paper: threshold': ('--', 'paper, 3 packets: threshold 0.5 to 0.1; half are read'),
    'AprilTag: decimation': ('-', 'AprilTag 3: decimation 4 to 1'),
    'QR code: zbar': ('-', 'QR code'),
}
"""Line and words of the curves that are drawn."""


def draw(figures: dict[str, Any]) -> Any:
    """Draw reach over processor time, wrong IDs as colour, and reach over the time to an answer."""
    figure, ((cost, answer),) = new_chart(
        1,
        2,
        16,
        7.8,
        "LiDAR: a hundredth of an AprilTag's computing or less; AprilTag: an answer at once",
    )
    curves = {name: points for name, points in figures['curves'].items() if name in _NAMES}
    for name, points in curves.items():
        how = look('QR code' if name.startswith('QR') else name.partition(':')[0])
        # Where four of five are hardly read anywhere, half are shown.
        key = 'half_m' if name.startswith('paper') else 'reach_m'
        shown = [point for point in points if point[key]['at'] is not None]
        style, words = _NAMES[name]
        for axis, place in ((cost, 'cpu_ms'), (answer, 'answer_s')):
            image = _draw_curve(axis, shown, place, key, how | {'linestyle': style, 'label': words})
    every = [point for points in curves.values() for point in points]
    cost.plot(*zip(*_frontier(every), strict=True), color='0.7', linewidth=5, alpha=0.5, zorder=0)
    if figures['told_m'] is not None:
        for axis in (cost, answer):
            axis.axhline(figures['told_m'], color=look('told')['color'], linestyle='--')
    answer.axvline(1e-3 * figures['frame_ms'], color='0.3', linestyle=':')
    answer.axvline(PACKET_S, color='0.3', linestyle='-.')
    cost.set_xlabel('processor time per second of watching [ms]')
    answer.set_xlabel('time to an answer [s]')
    cost.set_ylabel('80 % of markers of 3 cm are read to [m]')
    cost.legend(loc='lower left', fontsize=12)
    for axis in (cost, answer):
        axis.set_xscale('log')
        axis.set_ylim(0, 4.5)
    figure.colorbar(image, ax=answer, label='wrong IDs [%]', shrink=0.7)
    _legend(figure)
    return figure


def _draw_curve(axis: Any, shown: Sequence[dict[str, Any]], place: str, key: str, how: Any) -> Any:
    """Draw the settings of a knob with their confidence, wrong IDs as colour."""
    places = [point[place] for point in shown]
    reaches = np.array([point[key]['at'] for point in shown])
    low, high = ([point[key][end] for point in shown] for end in ('low', 'high'))
    ends = [reaches if None in bound else np.array(bound) for bound in (low, high)]
    bars = np.maximum([reaches - ends[0], ends[1] - reaches], 0)
    axis.plot(places, reaches, **how | {'markerfacecolor': 'white'}, linewidth=1.5)
    axis.errorbar(places, reaches, bars, linestyle='', color=how['color'], capsize=3)
    return axis.scatter(
        places,
        reaches,
        s=120,
        c=[100 * point['wrong']['rate'] for point in shown],
        cmap='Reds',
        vmin=0,
        vmax=100 * _MOST_WRONG,
        marker=how['marker'],
        edgecolors=how['color'],
        linewidths=2,
        zorder=3,
    )


def _legend(figure: Any) -> None:
    from matplotlib.lines import Line2D

    told = {'color': look('told')['color'], 'linestyle': '--'}
    lines = {
        'frontier: nothing cheaper reads farther': {'color': '0.7', 'linewidth': 5, 'alpha': 0.5},
        'bound of one packet: told all but the word': told,
        'one frame': {'color': '0.3', 'linestyle': ':'},
        'one packet': {'color': '0.3', 'linestyle': '-.'},
    }
    figure.legend(
        handles=[Line2D([], [], label=label, **how) for label, how in lines.items()],
        loc='outside lower center',
        ncols=4,
        frameon=False,
        fontsize=12,
    )
