# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each part of the decision buys: everything as it is, but for one part, or a set of them."""

import json
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.core_parts import PARTS, SETS
from evaluation.report.chart_style import WRONG_COLOUR, label, look, new_chart
from evaluation.report.claims import Table

TITLE = 'What each part buys'
CHANCE = 6  # packets or IDs: what two runs of other rooms may differ by
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
    faint = f'faint, of {figures["faint_packets"]}'
    rows = [['off', 'read', 'wrong', faint, 'hands', 'µs', 'lines']]
    for off, row in zip(figures['off'], figures['rows'], strict=True):
        rows.append(
            [
                off or 'nothing',
                f'{row["read"] / row["packets"]:.1%}',
                f'{row["wrong"]} of {row["readings"]}',
                f'{row["faint"]}',
                f'{row["false"]}',
                f'{row["frame_us"]:.0f}',
                f'{row["lines"]}',
            ]
        )
    return rows


class Change(NamedTuple):
    """What becomes of the core without a part."""

    name: str
    lost: float  # packets of rooms, and faint ones, that are read no longer
    wrong: float  # IDs more, in rooms and before hands
    time: float  # that a frame takes less [%]
    lines: float  # of code less


def _changes(figures: dict[str, Any]) -> list[Change]:
    """Return what each part buys and costs, what buys most first."""
    whole, *rows = figures['rows']

    def less(row: dict[str, Any], *names: str) -> float:
        return float(sum(whole[name] - row[name] for name in names))

    changes = [
        Change(
            off,
            lost=less(row, 'read', 'faint'),
            wrong=-less(row, 'wrong', 'false'),
            time=100 * less(row, 'frame_us') / whole['frame_us'],
            lines=less(row, 'lines'),
        )
        for off, row in zip(figures['off'][1:], rows, strict=True)
    ]
    return sorted(changes, key=lambda one: one.lost + one.wrong, reverse=True)


def _message(changes: Sequence[Change]) -> str:
    buys = [one for one in changes if max(one.lost, one.wrong) > CHANCE]
    rest = f'{len(changes) - len(buys)} of {len(changes)} change less than chance does'
    return f'Most is bought by {buys[0].name}; {rest}' if buys else rest


def draw(figures: dict[str, Any]) -> Any:
    """Draw what becomes worse without each part, and what time and lines are saved."""
    changes = _changes(figures)
    height = 1.9 + 0.235 * len(changes)
    figure, axes = new_chart(4, 4, height, _message(changes))
    panels: dict[str, tuple[list[float], str]] = {
        f'packets lost,\nof {figures["rows"][0]["packets"] + figures["faint_packets"]}': (
            [one.lost for one in changes],
            look('joint')['color'],
        ),
        'more wrong\nIDs': ([one.wrong for one in changes], WRONG_COLOUR),
        'time saved\n[% of a frame]': ([one.time for one in changes], '0.5'),
        'lines saved\n(of code)': ([one.lines for one in changes], '0.5'),
    }
    places = np.arange(len(changes))[::-1]
    for index, (axis, (title, (values, colour))) in enumerate(
        zip(axes, panels.items(), strict=True)
    ):
        axis.barh(places, values, color=colour, height=0.7)
        axis.axvline(0, color='0.3', linewidth=0.8)
        if index < 2:
            axis.axvspan(-CHANCE, CHANCE, color='0.85', zorder=0)
        label(axis, title=title, ylim=(-0.6, len(changes) - 0.4))
        axis.set_yticks(places, [one.name for one in changes] if index == 0 else [])
        axis.tick_params(labelsize=9)
        axis.set_title(title, fontsize=10.5)
    figure.supxlabel('what changes without a part; grey: within chance', fontsize=10.5)
    return figure
