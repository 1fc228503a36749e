# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the charts share: one colour a method, shares in percent with their confidence."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from evaluation.bench.rates import Rate
from retrolidar_ros.detector import METHODS

LEVEL = 0.8  # of identification; what is less counts as broken
# Told apart with any colour vision (Okabe and Ito), and by their signs without any.
_COLOURS = ('#0072b2', '#cc79a7')
_SIGNS = ('o', 'D')


ROUGH = 'rough: a quick run of few trials'


def mark_rough(path: Path) -> None:
    """Write below a chart that it is rough."""
    from matplotlib.figure import Figure
    from matplotlib.image import imread

    image = imread(path)
    height, width = image.shape[:2]
    figure = Figure(figsize=(width / 100, height / 100 + 0.3), dpi=100)
    figure.figimage(image, 0, 30)
    figure.text(0.5, 10 / (height + 30), ROUGH, ha='center', color='#d55e00', fontsize=12)
    figure.savefig(path)


def look(method: str) -> dict[str, Any]:
    """Return colour and sign of a method's curves."""
    index = METHODS.index(method)
    return {'color': _COLOURS[index], 'marker': _SIGNS[index], 'markersize': 4}


def new_chart(rows: int, columns: int, width: float, height: float) -> tuple[Any, Any]:
    """Return a figure [inches, 100 pixels each] and its axes, shape (rows, columns)."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), dpi=100, layout='constrained')
    axes = figure.subplots(rows, columns, squeeze=False)
    for panel in axes.flat:
        panel.grid(alpha=0.3)
        panel.tick_params(labelsize=9)
    return figure, axes


def draw_shares(axes: Any, places: Sequence[float], rates: Sequence[Rate], **how: Any) -> None:
    """Draw rates in percent over places, with a band of their confidence."""
    axes.plot(places, [100 * row['rate'] for row in rates], **how)
    axes.fill_between(
        places,
        [100 * row['low'] for row in rates],
        [100 * row['high'] for row in rates],
        color=how['color'],
        alpha=0.13,
        linewidth=0,
    )


def shared_legend(figure: Any, title: str, others: Sequence[tuple[str, dict[str, Any]]]) -> None:
    """Write one legend above all panels: a title, the methods, and other lines with their look."""
    from matplotlib.lines import Line2D

    entries = [(method, look(method)) for method in METHODS] + list(others)
    figure.legend(
        handles=[Line2D([], [], label=label, **how) for label, how in entries],
        loc='outside upper center',
        ncols=len(entries),
        frameon=False,
        title=title,
        title_fontsize=12,
        fontsize=11,
    )
