# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a track ends: after how many bits unseen a marker counts as gone."""

import json
import subprocess
import sys
from typing import Any

import numpy as np

from evaluation.bench.track_end_trial import RANGES_M, USED_BITS
from evaluation.report.chart_style import OTHERS, SHADES, label, legend_under, line, new_chart
from evaluation.report.claims import NOTHING, Table

TITLE = 'When tracks end'
_GONE_BITS = (6.0, USED_BITS, 12.0)
_GAPS_BITS = (2.0, 4.0, 6.0, 8.0, 10.0)
_TRIALS, _DURATION_S = 24, 30.0


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how tracks end, by the bits after which a marker counts as gone."""
    trials, duration_s = (2, 5.0) if quick else (_TRIALS, _DURATION_S)
    settings = [str(one) for one in (rng.integers(2**32), trials, duration_s, *_GAPS_BITS)]
    rows = []
    for bits in _GONE_BITS:
        # A process of its own each, as the core that is imported first stays.
        command = [sys.executable, '-m', 'evaluation.bench.track_end_trial', str(bits), *settings]
        text = subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout
        rows.append(json.loads(text))
    return {'gaps_bits': _GAPS_BITS, 'ranges_m': RANGES_M, 'rows': rows}


def _times(ends: list[list[float]]) -> str:
    """Return medians and 95 % of all ranges, in seconds."""
    return ', '.join(f'{one[0]:.2f}/{one[1]:.2f}' if one else NOTHING for one in ends)


def table(figures: dict[str, Any]) -> Table:
    """Return how tracks end, a column for each number of bits."""
    rows = figures['rows']
    at = ', '.join(f'{one:g}' for one in figures['ranges_m'])
    made = [['gone after so many bits unseen', *(f'{one["gone_bits"]:g}' for one in rows)]]
    for name in rows[0]['ends']:
        head = f'{name}: dropped after, at {at} m (median/95 %) [s]'
        made.append([head, *(_times(one['ends'][name]) for one in rows)])
    for index, gap in enumerate(figures['gaps_bits']):
        shares = [', '.join(f'{kept[index]:.0%}' for kept in one['kept']) for one in rows]
        made.append([f'followed on after a hand for {gap:g} bits, at {at} m', *shares])
    for scene in rows[0]['false_ends_an_hour']:
        ends = [f'{one["false_ends_an_hour"][scene]:.0f}' for one in rows]
        made.append([f'false ends an hour: {scene}', *ends])
    return made


def _message(figures: dict[str, Any]) -> str:
    used = next(one for one in figures['rows'] if one['gone_bits'] == USED_BITS)
    vanished, bright = (
        f'{max(one[-1] for one in used["ends"][end]):.2f} s' for end in ('vanished', 'stays bright')
    )
    return (
        f'95 of 100 markers that vanish are dropped within {vanished}, '
        f'that stay bright within {bright}'
    )


def draw(figures: dict[str, Any]) -> Any:
    """Draw the time until tracks end, and how often they end falsely, over the bits unseen."""
    rows = figures['rows']
    bits = [one['gone_bits'] for one in rows]
    figure, (times, ends) = new_chart(2, 2, 4.2, _message(figures))
    for colour, name in zip(OTHERS, rows[0]['ends'], strict=False):
        times.plot([], [], color=colour, label=name)
        for index, style in enumerate('-:'):
            worst = [one['ends'][name][index][-1] for one in rows]
            times.plot(bits, worst, color=colour, linestyle=style, marker='o')
    for range_m, style in zip(figures['ranges_m'], '-:', strict=True):
        times.plot([], [], **line(style), label=f'at {range_m:g} m')
    hourly = {
        scene: [one['false_ends_an_hour'][scene] for one in rows]
        for scene in rows[0]['false_ends_an_hour']
    }
    often, never = ([s for s in hourly if any(hourly[s]) == has] for has in (True, False))
    for colour, sign, scene in zip(SHADES, 'osDv^', often, strict=False):
        ends.plot(bits, hourly[scene], color=colour, marker=sign, label=scene)
    label(times, 'gone after bits unseen', '95 % are dropped after [s]', '')
    title = f'no track ends falsely if {" or ".join(never)}' if never else ''
    label(ends, 'gone after bits unseen', 'false ends [1/h]', title)
    ends.set(yscale='symlog', ylim=(-0.1, None))
    for axis in (times, ends):
        axis.axvline(USED_BITS, color='0.7', linewidth=1)
        axis.text(USED_BITS + 0.1, 0.15, 'as shipped', transform=axis.get_xaxis_transform())
        legend_under(axis, 2)
    return figure
