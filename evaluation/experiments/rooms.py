# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Random rooms: what is read, and what is read wrongly, by what was drawn."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from evaluation.bench.room_markers import MOTIONS, SENDINGS
from evaluation.bench.room_truth import BRIGHT_DB, COMPANY, SIGNALS
from evaluation.bench.rooms import counted, play_all, summary
from evaluation.report.chart_style import new_chart
from evaluation.report.claims import NOTHING, Table

TITLE = 'Random rooms'
MESSAGE = 'Random rooms: packets read, of how many; wrong IDs below'
ROOMS, QUICK_ROOMS = 400, 8
_DARK = 0.37  # so far from a half the map is dark
_DB = (f'below {BRIGHT_DB[0]:g} dB', f'to {BRIGHT_DB[1]:g} dB', 'brighter')


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return packets read and wrong IDs by all that was drawn."""
    return summary(play_all(range(QUICK_ROOMS if quick else ROOMS), int(rng.integers(2**32))))


def _rows() -> Iterator[tuple[str, str]]:
    yield from ((company, signal) for company in COMPANY for signal in SIGNALS)


def table(figures: dict[str, Any]) -> Table:
    """Return packets read and wrong IDs by company, signal and motion, and wrong IDs of all."""
    rows = [['packets read (wrong IDs)', *MOTIONS]]
    for company, signal in _rows():
        cells = []
        for motion in MOTIONS:
            packets, read, wrong = counted(figures, None, motion, company, signal)
            share = f'{read / packets:.0%} of {packets}' if packets else NOTHING
            cells.append(f'{share} ({wrong})' if wrong else share)
        rows.append([f'{company}, {_DB[SIGNALS.index(signal)]}', *cells])
    wrong, top = figures['wrong'], figures['by_margin'][-1]
    bound = f'{wrong["rate"]:.2%}, at most {wrong["high"]:.2%}'
    rows.append(['wrong of all readings', f'{wrong["hits"]} of {wrong["trials"]}', bound, ''])
    capped = f'{top["wrong"]} of {top["readings"]}'
    rows.append([f'… with a margin of {top["margin"]:g} nats or more', capped, '', ''])
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw a map of what is read for each company: sending and motion against signal."""
    figure, panels = new_chart(3, 3, 14, 9, MESSAGE)
    places = [(sending, motion) for sending in SENDINGS for motion in MOTIONS]
    for axis, company in zip(panels, COMPANY, strict=True):
        cells = [[counted(figures, *place, company, one) for one in SIGNALS] for place in places]
        shares = [
            [read / packets if packets else np.nan for packets, read, _ in row] for row in cells
        ]
        axis.grid(visible=False)
        axis.imshow(shares, cmap='RdYlBu', vmin=0, vmax=1, aspect='auto')
        for y, row in enumerate(cells):
            for x, (packets, read, wrong) in enumerate(row):
                words = f'{read / packets:.0%} of {packets}' if packets else ''
                words += f'\n{wrong} wrong' if wrong else ''
                dark = packets and abs(read / packets - 0.5) > _DARK
                colour = 'white' if dark else 'black'
                axis.text(x, y, words, color=colour, ha='center', va='center', fontsize=11)
        axis.set_title(
            {'beside': 'beside another', 'shared': 'sharing a zone'}.get(company, company)
        )
        axis.set_xticks(range(len(SIGNALS)), _DB, fontsize=11)
        names = [' '.join(place) for place in places] if axis is panels[0] else [''] * len(places)
        axis.set_yticks(range(len(places)), names, fontsize=11)
    return figure
