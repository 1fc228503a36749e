# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each part of the decision buys: everything as it is, but for one part, or a set of them."""

import json
import math
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np

from evaluation.bench.core_parts import PARTS, SETS
from evaluation.report.chart_style import OTHERS, new_chart
from evaluation.report.claims import Table

TITLE = 'What each part buys'
MESSAGE = 'What becomes worse without a part: packets lost, wrong IDs, reach'
ROOMS, QUICK_ROOMS = 30, 2
FAINT_RECORDINGS = 6  # of lone packets near the end of the reach, 16 a recording
HANDS_S = 300.0


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return what is read without each part and set of parts, the first being without none."""
    offs = ['', *list(PARTS)[:1]] if quick else ['', *PARTS, *SETS]
    rooms, recordings = (QUICK_ROOMS, 1) if quick else (ROOMS, FAINT_RECORDINGS)
    hands_s = HANDS_S / (60 if quick else 1)
    settings = [str(one) for one in (rng.integers(2**32), rooms, recordings, hands_s)]

    def measured(off: str) -> dict[str, Any]:
        # A process of its own each, as the core that is imported first stays.
        command = [sys.executable, '-m', 'evaluation.bench.core_trial', off, *settings]
        text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        row: dict[str, Any] = json.loads(text)
        return row

    with ThreadPoolExecutor(2) as pool:
        rows = list(pool.map(measured, offs))
    return {'off': offs, 'rows': rows, 'faint_packets': 16 * recordings}


def table(figures: dict[str, Any]) -> Table:
    """Return all figures, a row for each part that is off."""
    rows = [['off', 'read', 'wrong', f'faint, of {figures["faint_packets"]}', 'hands', 'µs']]
    for off, row in zip(figures['off'], figures['rows'], strict=True):
        rows.append(
            [
                off or 'nothing',
                f'{row["read"] / row["packets"]:.1%}',
                f'{row["wrong"]} of {row["readings"]}',
                f'{row["faint"]}',
                f'{row["false"]}',
                f'{row["frame_us"]:.0f}',
            ]
        )
    return rows


def _changes(figures: dict[str, Any], what: str, per: str | None = None) -> list[float]:
    """Return by how much each part's absence changes a figure, in percent if it is of others."""
    values = [100 * row[what] / row[per] if per else row[what] for row in figures['rows']]
    return [value - values[0] for value in values[1:]]


def draw(figures: dict[str, Any]) -> Any:
    """Draw a bar for each part in each of five panels: what its absence changes."""
    panels: Sequence[tuple[str, list[float]]] = (
        ('packets read [points]', _changes(figures, 'read', 'packets')),
        ('wrong IDs, of ' + str(figures['rows'][0]['readings']), _changes(figures, 'wrong')),
        (f'faint packets, of {figures["faint_packets"]}', _changes(figures, 'faint')),
        ('false IDs before hands', _changes(figures, 'false')),
        ('processor time [µs]', _changes(figures, 'frame_us')),
    )
    names = figures['off'][1:]
    figure, axes = new_chart(5, 5, 0.5 + 0.27 * len(names) + 1.2, MESSAGE)
    for axis, (title, values) in zip(axes, panels, strict=True):
        places = np.arange(len(names))[::-1]
        axis.barh(places, values, color=OTHERS[0], height=0.7)
        axis.axvline(0, color='0.3', linewidth=0.8)
        limit = 1.15 * max(1.0, max(abs(value) for value in values if math.isfinite(value)))
        axis.set(title=title, ylim=(-0.6, len(names) - 0.4), xlim=(-limit, limit))
        axis.set_yticks(places, names if axis is axes[0] else [])
    return figure
