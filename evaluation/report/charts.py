# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the charts share: one colour for the same thing everywhere, shares with confidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from evaluation.bench.rates import Rate
from retrolidar_ros.detector import METHODS

LEVEL = 0.8
"""Of identification: what is less counts as not read (paper §6.1)."""
# Distinct with any colour vision (Okabe and Ito), and by their signs without any.
_LOOKS = {
    'joint': ('#0072b2', 'o'),
    'paper': ('#cc79a7', 'D'),
    'AprilTag': ('#e69f00', 'v'),
    'AprilTag, all pixels': ('#d55e00', '^'),
    'QR code': ('#56b4e9', 'X'),
    'told': ('#009e73', '*'),
}
OTHERS = ('#332288', '#999933', '#882255', '#44aa99')
"""For what is no method (Tol's muted colours)."""
SHADES = ('#08306b', '#2b7bba', '#7db8da', '#fdae6b', '#d94801')
"""From harmless to bad."""


def look(name: str) -> dict[str, Any]:
    """Return colour and sign of what a name stands for."""
    colour, sign = _LOOKS[name]
    return {'color': colour, 'marker': sign, 'markersize': 5}


def new_chart(
    rows: int, columns: int, width: float, height: float, title: str = ''
) -> tuple[Any, Any]:
    """Return a figure [inches, 100 pixels each] and its axes, shape (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, layout='constrained')
    axes = figure.subplots(rows, columns, squeeze=False)
    for panel in axes.flat:
        panel.grid(alpha=0.3)
        panel.tick_params(labelsize=11)
        panel.xaxis.label.set_size(12)
        panel.yaxis.label.set_size(12)
    if title:
        figure.suptitle(title, fontsize=15, fontweight='bold')
    return figure, axes


def draw_shares(axes: Any, places: Sequence[float], rates: Sequence[Rate], **how: Any) -> None:
    """Draw rates in percent over places, with a band of their confidence."""
    axes.plot(places, [100 * row['rate'] for row in rates], **how)
    low, high = ([100 * row[end] for row in rates] for end in ('low', 'high'))
    axes.fill_between(places, low, high, color=how['color'], alpha=0.13, linewidth=0)


def draw_reads(
    axes: Any, points: Sequence[Mapping[str, Any]], names: Sequence[str] = METHODS
) -> None:
    """Draw right and, dashed, wrong shares over the places of points."""
    places = [point['place'] for point in points]
    for name in names:
        draw_shares(axes, places, [point[name]['right'] for point in points], **look(name))
        wrong = [100 * point[name]['wrong']['rate'] for point in points]
        axes.plot(places, wrong, linestyle='--', color=look(name)['color'], linewidth=1)
    axes.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
    axes.set_ylim(-2, 103)


def legend_below(
    figure: Any, names: Sequence[str], others: Mapping[str, Mapping[str, Any]] | None = None
) -> None:
    """Write one legend below all panels: what is drawn, and other lines with their looks."""
    from matplotlib.lines import Line2D

    words = {'joint': 'default, joint', 'paper': 'method paper'}
    entries = {words.get(name, name): look(name) for name in names} | dict(others or {})
    figure.legend(
        handles=[Line2D([], [], label=label, **how) for label, how in entries.items()],
        loc='outside lower center',
        ncols=min(len(entries), int(0.45 * figure.get_figwidth())),
        frameon=False,
        fontsize=12,
    )


WRONG = {'wrong ID': {'color': '0.2', 'linestyle': '--', 'linewidth': 1}}
"""Entry of a legend."""


def mark_rough(figure: Any) -> None:
    """Say on a chart that few trials made it."""
    figure.text(
        0.995, 0.995, 'QUICK RUN: ROUGH', ha='right', va='top', color='#d55e00', fontsize=11
    )
