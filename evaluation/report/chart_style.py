# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the charts share: one colour for the same thing everywhere, shares with confidence."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from evaluation.bench.rates import Rate
from retrolidar_ros.detector import METHODS

LEVEL = 0.8  # of identification: what is less counts as not read (paper §6.1)
# Distinct with any colour vision (Okabe and Ito), and by their signs without any.
_LOOKS = {
    'joint': ('#0072b2', 'o'),
    'paper': ('#cc79a7', 'D'),
    'AprilTag': ('#e69f00', 'v'),
    'AprilTag, all pixels': ('#d55e00', '^'),
    'QR code': ('#56b4e9', 'X'),
    'genie': ('#009e73', '*'),
}
_WORDS = {'joint': 'default, joint', 'paper': 'method paper', 'genie': 'genie-aided bound'}
OTHERS = ('#332288', '#999933', '#882255', '#44aa99')  # for what is no method (Tol's muted ones)
SHADES = ('#08306b', '#2b7bba', '#7db8da', '#fdae6b', '#d94801')  # from harmless to bad


def look(name: str) -> dict[str, Any]:
    """Return colour and sign of what a name stands for."""
    colour, sign = _LOOKS[name]
    return {'color': colour, 'marker': sign, 'markersize': 5}


def line(style: str, colour: str = '0.2') -> dict[str, Any]:
    """Return the look of a line that is no curve of a method."""
    return {'color': colour, 'linestyle': style}


WRONG = {'wrong ID': line('--') | {'linewidth': 1}}  # entry of a legend


def new_chart(
    count: int, columns: int, width: float, height: float, title: str
) -> tuple[Any, list[Any]]:
    """Return a figure [inches, 100 pixels each] and its panels, row by row."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, layout='constrained')
    rows = -(-count // columns)
    panels = [figure.add_subplot(rows, columns, 1 + index) for index in range(count)]
    for panel in panels:
        panel.grid(alpha=0.3)
    figure.suptitle(title, fontsize=15, fontweight='bold')
    return figure, panels


def label(
    axis: Any, x: str = '', y: str = '', title: str = '', *, percent: bool = False, **more: Any
) -> None:
    """Write what a panel shows and its axes; `more` is for matplotlib's `Axes.set`."""
    axis.set(**({'ylim': (-2, 103)} if percent else {}) | more)
    axis.set_xlabel(x, fontsize=12)
    axis.set_ylabel(y, fontsize=12)
    axis.set_title(title, fontsize=13)
    axis.tick_params(labelsize=11)


def draw_shares(axis: Any, places: Sequence[float], rates: Sequence[Rate], **how: Any) -> None:
    """Draw rates in percent over places, with a band of their confidence."""
    axis.plot(places, [100 * row['rate'] for row in rates], **how)
    low, high = ([100 * row[end] for row in rates] for end in ('low', 'high'))
    axis.fill_between(places, low, high, color=how['color'], alpha=0.13, linewidth=0)


def draw_reads(
    axis: Any,
    points: Sequence[Mapping[str, Any]],
    names: Iterable[str] = METHODS,
    *,
    wrong: bool = True,
    **how: Any,
) -> None:
    """Draw right and, dashed, wrong shares over the places of points."""
    places = [point['place'] for point in points]
    for name in names:
        draw_shares(axis, places, [point[name]['right'] for point in points], **look(name), **how)
        if wrong:
            rates = [100 * point[name]['wrong']['rate'] for point in points]
            axis.plot(places, rates, linestyle='--', color=look(name)['color'], linewidth=1)
    axis.axhline(100 * LEVEL, color='0.6', linewidth=0.8)


def draw_distribution(axis: Any, values: ArrayLike, **how: Any) -> None:
    """Draw which share of values [%] is no larger than each of them."""
    ordered = np.sort(np.asarray(values))
    shares = 100 * (np.arange(ordered.size) + 0.5) / max(ordered.size, 1)
    axis.plot(ordered, shares, **how)


def legend_below(
    figure: Any,
    names: Sequence[str] = (),
    others: Mapping[str, Mapping[str, Any]] | None = None,
    columns: int = 0,
) -> None:
    """Write one legend below all panels: what is drawn, and other lines with their looks."""
    from matplotlib.lines import Line2D

    entries = {_WORDS.get(name, name): look(name) for name in names} | dict(others or {})
    figure.legend(
        handles=[Line2D([], [], label=words, **how) for words, how in entries.items()],
        loc='outside lower center',
        ncols=columns or min(len(entries), int(0.45 * figure.get_figwidth())),
        frameon=False,
        fontsize=12,
    )


def legend_under(axis: Any, columns: int = 2) -> None:
    """Write the legend of one panel below it."""
    place = {'loc': 'upper center', 'bbox_to_anchor': (0.5, -0.13), 'borderaxespad': 0.0}
    axis.legend(**place, ncols=columns, frameon=False, fontsize=11)


def mark_rough(figure: Any) -> None:
    """Say on a chart that few trials made it."""
    title = f'{figure.get_suptitle()}\nQUICK RUN: ROUGH'
    figure.suptitle(title, color='#d55e00', fontsize=15, fontweight='bold')
