# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detector with a core of which something was changed, against the one that it has.

What each part of the decision gains is what is lost without it. What each number that was chosen by
hand gains is what is lost with its half or its double.
"""

import math
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench import core_trial, track_parts
from evaluation.bench.changed_core import Part, call_with, check_changes
from evaluation.bench.core_numbers import number_changes
from evaluation.bench.core_parts import part_changes
from evaluation.report.chart_style import SHADES, WRONG_COLOUR, new_chart
from evaluation.report.claims import Table

SIGMAS = 3.0  # of the change by chance; a larger one counts
_SIGMA_OF_MEDIAN = 1.48  # of a normal distribution, over the median of its absolute values
_CENTRED: dict[str, Any] = {'ha': 'center', 'va': 'center', 'fontsize': 9}
_WORST = 10.0  # percent lost, or wrong IDs more, that are coloured most
FAMILIES = {
    'rooms': 'random\nrooms',
    'pairs': 'two in\na zone',
    'crossing': 'crossing\nzones',
    'faint': 'at the\nlimit',
    'appearing': 'first\nID later',
    'followed': 'frames\nfollowed',
    'range': 'range\noff',
    'bearing': 'bearing\noff',
    'ellipsoid': 'out of\nellipsoid',
}
_NEGATIVE = ('appearing', 'range', 'bearing', 'ellipsoid')  # times and errors
_WRONG, _NO_MARKER, _IDS, _FALSE = 'wrong IDs', 'no marker', 'both', 'false'
_HEADS = {
    **FAMILIES,
    _WRONG: 'wrong\nIDs',
    _NO_MARKER: 'without\na marker',
    _FALSE: 'frames\nfollowed\nfalsely',
}


def _change(lost: Sequence[float]) -> dict[str, float]:
    """Return the sum of what scenes lose, and that over its standard deviation by chance.

    By chance each sign is as likely as the other.
    """
    deviation = math.sqrt(math.fsum(one * one for one in lost))
    total = math.fsum(lost)
    return {'lost': round(total, 3), 'sigmas': round(total / deviation, 2) if deviation else 0.0}


def _scenes_of(figures: dict[str, Any]) -> list[str]:
    """Return the names of figures that are lists of outcomes, one for a scene."""
    return [name for name, value in figures.items() if isinstance(value, list)]


def _against(whole: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Return what is lost by a change, from the same scenes."""
    row: dict[str, Any] = {}
    both = {name: [*zip(whole[name], other[name], strict=True)] for name in _scenes_of(whole)}
    marked = []
    for name in (one for one in FAMILIES if one in both):
        row[name] = _change([before[0] - after[0] for before, after in both[name]])
        marked += both[name]
    counted = {_FALSE: both[_FALSE]} if _FALSE in both else {}
    if _NO_MARKER in both:
        none = both[_NO_MARKER]
        counted = {_WRONG: marked, _NO_MARKER: none, _IDS: [*marked, *none]}
    for name, scenes in counted.items():
        row[name] = _change([after[2] - before[2] for before, after in scenes])
    row['lines'] = whole['lines'] - other['lines']
    return row


class Row(NamedTuple):
    """A change of the core, as a row of the chart."""

    name: str
    lost: dict[str, float]
    """Percent of packets, of the time to the first ID, or of the error, and wrong IDs more."""
    sigmas: dict[str, float]
    """Of wrong IDs with and without a marker together."""
    time: float  # that a frame takes less [%], 0 if it was not measured
    lines: int  # of code less

    @property
    def loses(self) -> bool:
        """Whether anything is worse, beyond chance."""
        return max(self.sigmas.values()) > SIGMAS


def _rows(figures: dict[str, Any]) -> list[Row]:
    """Return all changes, in the order in which they were made."""

    def percent(row: dict[str, Any], name: str) -> float:
        if name not in FAMILIES:
            return float(row[name]['lost'])
        of = figures['whole'][name][0 if name in _NEGATIVE else 1]
        # In a few scenes there may be no error, of which nothing is a share.
        return float(100 * row[name]['lost'] / (abs(of) or math.inf))

    rows = []
    for row in figures['rows']:
        lost = {name: percent(row, name) for name in _HEADS if name in row}
        sure = {name: _IDS if name in (_WRONG, _NO_MARKER) else name for name in lost}
        sigmas = {name: row[one]['sigmas'] for name, one in sure.items()}
        rows.append(Row(row['off'], lost, sigmas, row.get('time', 0.0), row['lines']))
    return rows


def _text(name: str, value: float) -> str:
    if abs(value) < (0.05 if name in FAMILIES else 0.5):
        return '·'
    digits = 1 if name in FAMILIES and abs(value) < 9.95 else 0
    return f'{value:+.{digits}f}'.replace('-', '\N{MINUS SIGN}')


def _draw_cells(axis: Any, rows: Sequence[Row]) -> None:
    """Write what each change makes worse, on a shade if it is so beyond chance."""
    for y, one in enumerate(rows):
        for x, (name, value) in enumerate(one.lost.items()):
            sigmas = one.sigmas[name]
            colour, weight = '0.6', 'normal'
            if abs(sigmas) > SIGMAS and value * sigmas > 0:
                colour, weight = 'black', 'bold'
                worse = SHADES[1] if name in FAMILIES else WRONG_COLOUR
                alpha = 0.15 + 0.45 * min(abs(value) / _WORST, 1)
                shade = {'color': worse if sigmas > 0 else '0.5', 'alpha': alpha, 'linewidth': 0}
                axis.fill_between([x - 0.5, x + 0.5], y - 0.5, y + 0.5, **shade)
            axis.text(x, y, _text(name, value), color=colour, fontweight=weight, **_CENTRED)


def _draw_saved(axis: Any, rows: Sequence[Row], *, timed: bool) -> None:
    """Write what lines each change saves, and what time if known, in grey what it may not.

    Most changes hardly change the time, so the median change is that of chance.
    """
    by_chance = SIGMAS * _SIGMA_OF_MEDIAN * float(np.median([abs(one.time) for one in rows]))
    for y, one in enumerate(rows):
        saved = [(-float(one.lines), not one.lines)]
        saved += [(-one.time, abs(one.time) <= by_chance)] * timed
        for x, (number, grey) in enumerate(saved, len(one.lost)):
            text = f'{number:+.0f}'.replace('-', '\N{MINUS SIGN}') if round(number) else '·'
            axis.text(x, y, text, color='0.6' if grey else 'black', **_CENTRED)


@dataclass(frozen=True)
class CoreChanges:
    """An experiment on some changes of the core, one at a time."""

    TITLE: str
    change: str  # what is done, as a word below the chart
    changes: Callable[[], Mapping[str, Sequence[Part]]]  # by name
    message: Callable[[Sequence[Row]], str]  # the title of the chart
    measure: Callable[[int, float], dict[str, Any]] = core_trial.measure
    """Returns outcomes by a seed, and the share of the usual scenes."""
    frame_times_us: Callable[[int, int], list[float]] | None = None
    """Returns times of a frame in some rooms, by a seed and their number."""
    of_parts: bool = False  # those that surely lose come first, with the time and lines they save

    def run(self, rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
        """Return what the detector loses by each change.

        Raises ValueError before anything is run if the core has no such line any longer.
        """
        changes = self.changes()
        check_changes(changes)
        names = list(changes)[: 1 if quick else None]
        seed, times, rooms = int(rng.integers(2**32)), *((0.01, 1) if quick else (0.3, 16))

        def measured(name: str) -> dict[str, Any]:
            row: dict[str, Any] = call_with(changes.get(name, ()), self.measure, seed, times)
            print(f'measured {name or "as it is"}', file=sys.stderr, flush=True)
            return row

        # Each in a process of its own, one a core.
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            whole, *others = pool.map(measured, ['', *names])
        rows = [
            {'off': name, **_against(whole, other)}
            for name, other in zip(names, others, strict=True)
        ]
        sums = {name: np.sum(whole[name], axis=0).tolist() for name in _scenes_of(whole)}
        figures: dict[str, Any] = {'whole': sums, 'rows': rows}
        if timed := self.frame_times_us:
            for row in rows:
                # Side by side, as the speed of a processor varies by more than most parts take.
                with ThreadPoolExecutor(2) as pool:
                    runs = pool.map(
                        lambda one: call_with(one, timed, seed, rooms), ((), changes[row['off']])
                    )
                before, after = (math.fsum(times_us) for times_us in runs)
                row['time'] = round(100 * (1 - after / before), 1)
        return figures

    def missing_table(self, figures: dict[str, Any]) -> Table:
        """Return the changes that have come since the figures were measured."""
        measured = {row['off'] for row in figures['rows']}
        missing = [name for name in self.changes() if name not in measured]
        return [['not in the chart, as it is newer'], ['; '.join(missing) or 'none']]

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw a map of what each change makes worse, and what time and lines it saves."""
        # Of figures that are older than the core, without what it does not have any longer.
        present = self.changes()
        rows = [one for one in _rows(figures) if one.name in present]
        names, timed = [*rows[0].lost], 'time' in figures['rows'][0]
        heads = [_HEADS[name] for name in names]
        if self.of_parts:
            rows.sort(key=lambda one: (not one.loses, -max(one.sigmas.values())))
            heads += ['lines\nof code', *['time\n[%]'] * timed]
        figure, (axis,) = new_chart(1, 1, 2.6 + 0.235 * len(rows), self.message(rows))
        axis.grid(visible=False)
        _draw_cells(axis, rows)
        below = ''
        if self.of_parts:
            _draw_saved(axis, rows, timed=timed)
            if count := sum(one.loses for one in rows):
                axis.axhline(count - 0.5, color='black', linewidth=1)
            below = '\nThose below the line gain nothing that shows in these scenes.'
        for border in (sum(name in FAMILIES for name in names) - 0.5, len(names) - 0.5):
            axis.axvline(border, color='0.8', linewidth=0.8)
        axis.set(xlim=(-0.5, len(heads) - 0.5), ylim=(len(rows) - 0.5, -0.5))
        axis.set_xticks(range(len(heads)), heads, fontsize=9, rotation=90)
        axis.set_yticks(range(len(rows)), [one.name for one in rows], fontsize=9)
        axis.tick_params(length=0, top=False, labeltop=True, labelbottom=False)
        words = (
            f'What changes {self.change} it: lost, time or error more [%]; IDs or frames more.\n'
            f'Bold: beyond {SIGMAS:g}\N{GREEK SMALL LETTER SIGMA} of chance; on grey: better so.'
        )
        figure.supxlabel(words + below, fontsize=10)
        return figure


def _parts_message(parts: Sequence[Row]) -> str:
    count = sum(one.loses for one in parts)
    return f'{count} of {len(parts)} parts, or sets of them, gain more than by chance' + (
        f'; surest: {parts[0].name}' if count else ''
    )


def _numbers_message(rows: Sequence[Row]) -> str:
    names = {one.name.split()[0]: False for one in rows}
    names |= {one.name.split()[0]: True for one in rows if one.loses}
    better = sum(min(one.sigmas.values()) < -SIGMAS and not one.loses for one in rows)
    matter = f'{sum(names.values())} of {len(names)} numbers matter, halved or doubled'
    return f'{matter}; {better or "no"} other value is better and nowhere worse'


CORE_CHANGES = {
    'parts': CoreChanges(
        'What each part gains',
        'without',
        part_changes,
        _parts_message,
        frame_times_us=core_trial.frame_times_us,
        of_parts=True,
    ),
    'track-parts': CoreChanges(
        'What each part gains that follows markers',
        'without',
        track_parts.track_changes,
        _parts_message,
        track_parts.measure,
        of_parts=True,
    ),
    'numbers': CoreChanges('What each number gains', 'with', number_changes, _numbers_message),
}
"""By the name of the experiment."""
