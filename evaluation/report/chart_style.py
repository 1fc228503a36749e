# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the charts share: one colour for the same thing everywhere, shares with confidence."""

import re
from collections.abc import Iterable, Mapping, Sequence
from textwrap import fill, wrap
from typing import Any

from evaluation.bench.rates import LEVEL, Rate
from retrolidar_ros.detector import METHODS

_WIDTH, _TITLE_LETTERS = 8.0, 66  # of a chart [inches], and of a line of its title
# Distinct with any colour vision (Okabe and Ito), and by their signs without any.
_LOOKS = {
    'joint': ('#0072b2', 'o'),
    'registered': ('#56b4e9', 's'),
    'tracks': ('#009e73', 'P'),
    'paper': ('#cc79a7', 'D'),
    'AprilTag': ('#e69f00', 'v'),
    'AprilTag, all pixels': ('#d55e00', '^'),
    'QR code': ('#8c564b', 'X'),
    'genie': ('#555555', '*'),
}
_BENEATH = ('joint', 'AprilTag')  # drawn first and broad, so that no other hides them
WORDS = {
    'joint': 'default',
    'registered': 'IDs registered',
    'tracks': 'tracks',
    'paper': "the paper's method",
}
OTHERS = ('#332288', '#999933', '#882255', '#44aa99')  # for what is no method (Tol's muted ones)
SHADES = ('#08306b', '#2b7bba', '#7db8da', '#fdae6b', '#d94801')  # from harmless to bad


def look(name: str) -> dict[str, Any]:
    """Return colour and sign of what a name stands for."""
    colour, sign = _LOOKS[name]
    broad, size = (2.8, 6.5) if name in _BENEATH else (1.5, 5)
    return {'color': colour, 'marker': sign, 'markersize': size, 'linewidth': broad}


def line(style: str, colour: str = '0.2') -> dict[str, Any]:
    """Return the look of a line that is no curve of a method."""
    return {'color': colour, 'linestyle': style}


WRONG_COLOUR = '#b00000'
WRONG = {'wrong IDs': line('--') | {'linewidth': 1}}  # entry of a legend


def new_chart(count: int, columns: int, height: float, title: str) -> tuple[Any, list[Any]]:
    """Return a figure and its panels, row by row; 100 pixels are an inch.

    All charts are as wide as a page, so that their letters are as large as its text.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_WIDTH, height), dpi=100, layout='constrained')
    rows = -(-count // columns)
    panels = [figure.add_subplot(rows, columns, 1 + index) for index in range(count)]
    for panel in panels:
        panel.grid(alpha=0.3)
    title = re.sub(r'(\d) ', '\\1\N{NO-BREAK SPACE}', title)  # a number keeps its unit
    lines = -(-len(title) // _TITLE_LETTERS)
    # Lines of a like length, and no more of them: none has a word alone.
    width = max(20, round(1.1 * len(title) / lines))
    while len(wrap(title, width)) > lines:
        width += 1
    figure.suptitle(fill(title, width), fontsize=13, fontweight='bold')
    return figure, panels


def label(
    axis: Any,
    x: str = '',
    y: str = '',
    title: str = '',
    *,
    percent: bool = False,
    xticks: Sequence[float] = (),
    yticks: Sequence[float] = (),
    **more: Any,
) -> None:
    """Write what a panel shows and its axes; `more` is for matplotlib's `Axes.set`."""
    axis.set(**({'ylim': (-2, 103)} if percent else {}) | more)
    for ticked, values in ((axis.xaxis, xticks), (axis.yaxis, yticks)):
        if len(values):
            ticked.set_ticks([], minor=True)
            ticked.set_ticks(values, [f'{value:g}' for value in values])
    axis.set_xlabel(x, fontsize=11)
    axis.set_ylabel(y, fontsize=11)
    axis.set_title(title, fontsize=11.5)
    axis.tick_params(labelsize=10.5)


def name_curve(axis: Any, name: str, text: str, place: tuple[float, float], **more: Any) -> None:
    """Write beside a curve, in its colour, what it is; `place` is in the units of the axes."""
    how = {'fontsize': 11, 'fontweight': 'bold', 'va': 'center'} | more
    axis.text(*place, text, color=look(name)['color'], **how)


def draw_level(axis: Any, y: float, words: str, x: float = 0.99, **how: Any) -> None:
    """Draw a horizontal line, with words on it that end at a share of the width."""
    axis.axhline(y, **({'color': '0.4', 'linewidth': 1} | how))
    beside = {'transform': axis.get_yaxis_transform(), 'ha': 'right', 'va': 'bottom'}
    axis.text(x, y, words, fontsize=10, color='0.3', **beside)


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


def legend_below(
    figure: Any,
    names: Sequence[str] = (),
    others: Mapping[str, Mapping[str, Any]] | None = None,
) -> None:
    """Write one legend below all panels: what is drawn, and other lines with their looks."""
    from matplotlib.lines import Line2D

    entries = {WORDS.get(name, name): look(name) for name in names} | dict(others or {})
    longest = 0.6 + 0.088 * max(map(len, entries))  # of an entry [inches]
    figure.legend(
        handles=[Line2D([], [], label=words, **how) for words, how in entries.items()],
        loc='outside lower center',
        ncols=max(1, min(len(entries), int(_WIDTH / longest))),
        frameon=False,
        fontsize=11,
    )


def legend_beside(axis: Any) -> None:
    """Write the legend of one panel at its right, where no other panel is."""
    place = {'loc': 'center left', 'bbox_to_anchor': (1.05, 0.5)}
    axis.legend(**place, frameon=False, fontsize=10.5).set_in_layout(False)


def mark_rough(figure: Any) -> None:
    """Say on a chart that few trials made it."""
    title = f'{figure.get_suptitle()}\nQUICK RUN: ROUGH'
    figure.suptitle(title, color='#d55e00', fontsize=13, fontweight='bold')
