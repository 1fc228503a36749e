# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each part of the decision gains: the detector with and without it."""

import math
import os
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench import core_trial
from evaluation.bench.core_parts import PARTS, SETS, Part, check_parts, names_of
from evaluation.bench.core_process import call_with
from evaluation.report.chart_style import SHADES, WRONG_COLOUR, new_chart
from evaluation.report.claims import Table

TITLE = 'What each part gains'
SIGMAS = 3.0  # of the change by chance; a larger one counts
_WORST = 10.0  # percent lost, or wrong IDs more, that are coloured most
FAMILIES = {
    'rooms': 'random\nrooms',
    'pairs': 'two in\na zone',
    'crossing': 'crossing\nzones',
    'faint': 'at the\nlimit',
    'appearing': 'first\nID later',
    'range': 'range\noff',
    'bearing': 'bearing\noff',
    'ellipsoid': 'out of\nellipsoid',
}
_NEGATIVE = ('appearing', 'range', 'bearing', 'ellipsoid')  # times and errors
_WRONG, _NO_MARKER, _IDS = 'wrong IDs', 'no marker', 'both'
_HEADS = {**FAMILIES, _WRONG: 'wrong\nIDs', _NO_MARKER: 'without\na marker'}


def _changes(off: str) -> list[Part]:
    return [PARTS[name] for name in names_of(off)]


def _measured(off: str, seed: int, times: float) -> dict[str, Any]:
    """Measure without a part, in a process of its own."""
    row: dict[str, Any] = call_with(_changes(off), f'{core_trial.__name__}.measure', seed, times)
    print(f'measured {f"without {off}" if off else "as it is"}', file=sys.stderr, flush=True)
    return row


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return what the detector loses without each part and set of parts.

    Raises ValueError before anything is run if the core has no such part any longer.
    """
    check_parts()
    offs = [*PARTS][:1] if quick else [*PARTS, *SETS]
    seed, times, rooms = int(rng.integers(2**32)), *((0.05, 1) if quick else (0.7, 6))
    # Each in a process of its own, one a core; times are measured alone.
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        whole, *others = pool.map(lambda off: _measured(off, seed, times), ['', *offs])
    rows = []
    for off, other in zip(offs, others, strict=True):
        rows.append({'off': off, **_against(whole, other), 'time': _time_less(off, seed, rooms)})
    return {
        'whole': {name: np.sum(whole[name], axis=0).tolist() for name in (*FAMILIES, _NO_MARKER)},
        # The change of time between two runs of the same core.
        'time_by_chance': abs(_time_less('', seed, rooms)),
        'rows': rows,
    }


def _time_less(off: str, seed: int, rooms: int) -> float:
    """Return how much less time a frame takes without a part, one run right after the other [%]."""
    function = f'{core_trial.__name__}.frame_times_us'
    before, after = (call_with(_changes(one), function, seed, rooms) for one in ('', off))
    # Each room counts alike, so that one that was interrupted does not decide.
    return round(100 * (1 - float(np.median(np.divide(after, before)))), 1)


def _change(lost: Sequence[float]) -> dict[str, float]:
    """Return the sum of what scenes lose, and that over its standard deviation by chance.

    By chance each sign is as likely as the other.
    """
    deviation = math.sqrt(math.fsum(one * one for one in lost))
    total = math.fsum(lost)
    return {'lost': round(total, 3), 'sigmas': round(total / deviation, 2) if deviation else 0.0}


def _against(whole: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Return what is lost without a part, from the same scenes with and without."""
    row: dict[str, Any] = {}
    for name in FAMILIES:
        pairs = zip(whole[name], other[name], strict=True)
        row[name] = _change([before[0] - after[0] for before, after in pairs])
    marked = [pair for name in FAMILIES for pair in zip(whole[name], other[name], strict=True)]
    none = [*zip(whole[_NO_MARKER], other[_NO_MARKER], strict=True)]
    for name, scenes in ((_WRONG, marked), (_NO_MARKER, none), (_IDS, [*marked, *none])):
        row[name] = _change([after[2] - before[2] for before, after in scenes])
    row['lines'] = whole['lines'] - other['lines']
    return row


class Row(NamedTuple):
    """A part of the detector, as a row of the chart."""

    name: str
    lost: dict[str, float]
    """Percent of packets, of the time to the first ID, or of the error, and wrong IDs more."""
    sigmas: dict[str, float]
    """Of wrong IDs with and without a marker together."""
    time: float  # that a frame takes less [%]
    lines: int  # of code less

    @property
    def gains(self) -> bool:
        """Whether anything is worse without it, beyond chance."""
        return max(self.sigmas.values()) > SIGMAS


def _rows(figures: dict[str, Any]) -> list[Row]:
    """Return all parts, those that gain most first, and of those that gain nothing the slowest."""

    def percent(row: dict[str, Any], name: str) -> float:
        if name not in FAMILIES:
            return float(row[name]['lost'])
        of = figures['whole'][name][0 if name in _NEGATIVE else 1]
        return float(100 * row[name]['lost'] / abs(of))

    parts = [
        Row(
            row['off'],
            {name: percent(row, name) for name in _HEADS},
            {name: row[name if name in FAMILIES else _IDS]['sigmas'] for name in _HEADS},
            row['time'],
            row['lines'],
        )
        for row in figures['rows']
    ]

    def order(one: Row) -> tuple[bool, float]:
        worse = [one.lost[name] for name in _HEADS if one.sigmas[name] > SIGMAS]
        return (not one.gains, -sum(worse) if one.gains else -one.time)

    return sorted(parts, key=order)


def _text(name: str, value: float) -> str:
    if abs(value) < (0.05 if name in FAMILIES else 0.5):
        return '·'
    digits = 1 if name in FAMILIES and abs(value) < 9.95 else 0
    return f'{value:+.{digits}f}'.replace('-', '\N{MINUS SIGN}')


def table(figures: dict[str, Any]) -> Table:
    """Return all figures, a row for each part; in brackets, in deviations of chance."""
    heads = [head.replace('\n', ' ') for head in _HEADS.values()]
    rows = [['without', *heads, 'time [%]', 'lines', 'gains']]
    for one in _rows(figures):
        cells = [f'{_text(name, one.lost[name])} ({one.sigmas[name]:+.1f})' for name in _HEADS]
        saved = [f'{-one.time:+.0f}', f'{-one.lines:+d}', 'yes' if one.gains else '']
        rows.append([one.name, *cells, *saved])
    return rows


def _message(parts: Sequence[Row]) -> str:
    gaining = [one for one in parts if one.gains]
    rest = f'{len(gaining)} of {len(parts)} parts, or sets of them, gain more than by chance'
    return f'{rest}; most: {gaining[0].name}' if gaining else rest


def draw(figures: dict[str, Any]) -> Any:
    """Draw a map of what becomes worse without each part, and what time and lines are saved."""
    parts = _rows(figures)
    columns = len(_HEADS) + 2
    figure, (axis,) = new_chart(1, 1, 2.6 + 0.235 * len(parts), _message(parts))
    axis.grid(visible=False)
    for y, one in enumerate(parts):
        for x, name in enumerate(_HEADS):
            value, sigmas = one.lost[name], one.sigmas[name]
            colour, weight = '0.6', 'normal'
            if abs(sigmas) > SIGMAS and value * sigmas > 0:
                colour, weight = 'black', 'bold'
                worse = SHADES[1] if name in FAMILIES else WRONG_COLOUR
                alpha = 0.15 + 0.45 * min(abs(value) / _WORST, 1)
                shade = {'color': worse if sigmas > 0 else '0.5', 'alpha': alpha, 'linewidth': 0}
                axis.fill_between([x - 0.5, x + 0.5], y - 0.5, y + 0.5, **shade)
            how = {'ha': 'center', 'va': 'center', 'fontsize': 9}
            axis.text(x, y, _text(name, value), color=colour, fontweight=weight, **how)
        by_chance = abs(one.time) <= max(3.0, figures['time_by_chance'])
        saved = ((-one.time, by_chance), (-float(one.lines), not one.lines))
        for last, (number, grey) in enumerate(saved):
            x = len(_HEADS) + last
            text = f'{number:+.0f}'.replace('-', '\N{MINUS SIGN}') if round(number) else '·'
            axis.text(x, y, text, color='0.6' if grey else 'black', **how)
    count = sum(one.gains for one in parts)
    if count:
        axis.axhline(count - 0.5, color='black', linewidth=1)
    for border in (len(FAMILIES) - 0.5, len(_HEADS) - 0.5):
        axis.axvline(border, color='0.8', linewidth=0.8)
    axis.set(xlim=(-0.5, columns - 0.5), ylim=(len(parts) - 0.5, -0.5))
    heads = [*_HEADS.values(), 'time\n[%]', 'lines\nof code']
    axis.set_xticks(range(columns), heads, fontsize=9, rotation=90)
    axis.set_yticks(range(len(parts)), [one.name for one in parts], fontsize=9)
    axis.tick_params(length=0, top=False, labeltop=True, labelbottom=False)
    figure.supxlabel(
        'What changes without it: packets lost [%], time or error more [%], IDs more.\n'
        f'Bold: beyond {SIGMAS:g}\N{GREEK SMALL LETTER SIGMA} of chance; on grey: better without.\n'
        'Those below the line gain nothing that shows in these scenes.',
        fontsize=10,
    )
    return figure
