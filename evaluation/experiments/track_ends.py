# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""When a track ends: after how many bits unseen a marker counts as gone."""

from typing import Any

import numpy as np

from evaluation.bench.core_parts import Part, call_with
from evaluation.bench.following import ENDS, SCENES, dropped_s, false_ends
from evaluation.report.chart_style import OTHERS, SHADES, label, legend_under, line, new_chart

TITLE = 'When tracks end'
_USED_BITS = 8.5  # by the core
_RANGES_M = (1.0, 2.0)
_GONE_BITS = (6.0, _USED_BITS, 12.0)
_TRIALS, _DURATION_S = 24, 30.0
_LINE = 'GONE_BITS = {:g}'


def measure(gone_bits: float, seed: int, trials: int, duration_s: float) -> dict[str, Any]:
    """Return how tracks end by the imported core, in which `gone_bits` is set."""
    rng = np.random.default_rng(seed)
    ends: dict[str, list[list[float]]] = {}
    for name in ENDS:
        drops = [[dropped_s(at, rng, end=name) for _ in range(trials)] for at in _RANGES_M]
        times_s = [[one for one in own if one is not None] for own in drops]
        ends[name] = [np.percentile(one, [50, 95]).tolist() if one else [] for one in times_s]
    hours = trials * duration_s / 3600
    return {
        'gone_bits': gone_bits,
        'ends': ends,
        'false_ends_an_hour': {
            scene: sum(false_ends(scene, duration_s, rng) for _ in range(trials)) / hours
            for scene in SCENES
        },
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how tracks end, by the bits after which a marker counts as gone."""
    settings = (int(rng.integers(2**32)), *((2, 5.0) if quick else (_TRIALS, _DURATION_S)))
    rows = []
    for bits in _GONE_BITS:
        change = Part('presence', _LINE.format(_USED_BITS), _LINE.format(bits))
        rows.append(call_with([change], measure, bits, *settings))
    return {'ranges_m': _RANGES_M, 'rows': rows}


def draw(figures: dict[str, Any]) -> Any:
    """Draw the time until tracks end, and how often they end falsely, over the bits unseen."""
    rows = figures['rows']
    used = next(one['ends'] for one in rows if one['gone_bits'] == _USED_BITS)
    vanished, bright = (max(one[-1] for one in used[end]) for end in ('vanished', 'stays bright'))
    title = (
        f'95 of 100 markers that vanish are dropped within {vanished:.2f} s, '
        f'that stay bright within {bright:.2f} s'
    )
    bits = [one['gone_bits'] for one in rows]
    figure, (times, ends) = new_chart(2, 2, 4.2, title)
    for colour, name in zip(OTHERS, ENDS, strict=False):
        times.plot([], [], color=colour, label=name)
        for index, style in enumerate('-:'):
            worst = [one['ends'][name][index][-1] for one in rows]
            times.plot(bits, worst, color=colour, linestyle=style, marker='o')
    for range_m, style in zip(_RANGES_M, '-:', strict=True):
        times.plot([], [], **line(style), label=f'at {range_m:g} m')
    hourly = {scene: [one['false_ends_an_hour'][scene] for one in rows] for scene in SCENES}
    often, never = ([s for s in hourly if any(hourly[s]) == has] for has in (True, False))
    for colour, sign, scene in zip(SHADES, 'osDv^', often, strict=False):
        ends.plot(bits, hourly[scene], color=colour, marker=sign, label=scene)
    x, title = 'gone after bits unseen', f'no track ends falsely if {" or ".join(never)}'
    label(times, x, '95 % are dropped after [s]')
    label(ends, x, 'false ends [1/h]', title if never else '', yscale='symlog', ylim=(-0.1, None))
    for axis in (times, ends):
        axis.axvline(_USED_BITS, color='0.7', linewidth=1)
        axis.text(_USED_BITS + 0.1, 0.15, 'as shipped', transform=axis.get_xaxis_transform())
        legend_under(axis, 2)
    return figure
