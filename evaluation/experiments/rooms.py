# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Random rooms: packets read and wrong IDs, by sending, motion, company and signal."""

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from evaluation.bench.places import held
from evaluation.bench.rates import rate
from evaluation.bench.room_markers import MOTIONS, SENDINGS
from evaluation.bench.room_truth import BRIGHT_DB, COMPANY, SIGNALS, SentPacket, WrongReading
from evaluation.bench.rooms import RoomResult, play
from evaluation.report.chart_style import WRONG_COLOUR, new_chart
from evaluation.report.claims import NOTHING, Table, percent

TITLE = 'Random rooms'
ROOMS, QUICK_ROOMS = 300, 8
_MARGINS = (0, 15, 29.9)  # [nats]
_CELL = ('sending', 'motion', 'company', 'signal')
_TWO_SIGMAS = 1.96  # that 95 % are within
_FEW = 30  # packets, whose share says little
_DARK = 0.55  # a share from which the map is dark
_BOLD = {'fontsize': 13, 'fontweight': 'bold'}
_SHORT_DB = (f'< {BRIGHT_DB[0]:g}', f'to {BRIGHT_DB[1]:g}', f'> {BRIGHT_DB[1]:g}')
_SENDINGS = {
    'repeating': 'repeats',
    'lone': 'one packet',
    'pauses': 'with pauses',
    'sequence': 'ever new IDs',
}
_MOTIONS = {'still': 'at rest', 'swaying': 'swaying', 'crossing': 'crossing zones'}
_DB = f'above {BRIGHT_DB[1]:g} dB'
_COMPANY = {'beside': 'beside another', 'shared': 'sharing a zone'}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return packets read and wrong IDs."""
    seed = int(rng.integers(2**32))
    return summary([play(number, seed) for number in range(QUICK_ROOMS if quick else ROOMS)])


def summary(results: Sequence[RoomResult]) -> dict[str, Any]:
    """Return the figures of some rooms, fit for JSON."""
    packets: Counter[tuple[str, ...]] = Counter()
    read: Counter[tuple[str, ...]] = Counter()
    wrong: Counter[tuple[str, ...]] = Counter()
    for result in results:
        for sent, was_read in zip(result.scored.sent, result.scored.read, strict=True):
            if sent.whole:
                packets[_cell(sent)] += 1
                read[_cell(sent)] += was_read
        wrong.update(_cell(one) for one in result.scored.wrong)
    readings = [one for result in results for one in result.scored.readings]
    mistaken = [margin for margin, right in readings if not right]
    counts = {'packets': packets, 'read': read, 'wrong': wrong}
    cells = [
        dict(zip(_CELL, cell, strict=True)) | {name: of[cell] for name, of in counts.items()}
        for cell in sorted({*packets, *wrong})
    ]
    return {
        'rooms': len(results),
        'readings': len(readings),
        'wrong': rate(len(mistaken), max(len(readings), 1)),
        'by_margin': [
            {
                'margin': margin,
                'readings': sum(found >= margin for found, _ in readings),
                'wrong': sum(found >= margin for found in mistaken),
            }
            for margin in _MARGINS
        ],
        'cells': cells,
        'places': [_place(results, company, motion) for company in COMPANY for motion in MOTIONS],
        'wrong_ids': [
            {'room': result.room, **one._asdict()}
            for result in results
            for one in result.scored.wrong
        ],
    }


def _place(results: Sequence[RoomResult], company: str, motion: str) -> dict[str, Any]:
    """Return how far right readings are from their markers."""
    placed = [one for result in results for one in result.scored.placed]
    own = [one for one in placed if (one.company, one.motion) == (company, motion)]
    inside = [abs(one.range_deviations) <= _TWO_SIGMAS for one in own]
    errors_mm = [1e3 * abs(one.error.range_m) for one in own]
    stddevs_mm = [1e3 * one.range_stddev_m for one in own]
    return {
        'company': company,
        'motion': motion,
        'readings': len(own),
        # What half, and what nine tenths are less off than.
        'range_mm': np.quantile(errors_mm, (0.5, 0.9)).tolist() if own else None,
        'stddev_mm': np.quantile(stddevs_mm, (0.5, 0.9)).tolist() if own else None,
        'range_holds': rate(sum(inside), len(inside)) if inside else None,
        'ellipsoid_holds': held([one.error.squared_distance for one in own]),
    }


def _cell(one: SentPacket | WrongReading) -> tuple[str, str, str, str]:
    sending = one.sending if isinstance(one, SentPacket) else one.near
    return sending, one.motion, one.company, one.signal


def counted(figures: dict[str, Any], *cell: str | None) -> tuple[int, int, int]:
    """Return packets, how many were read, and wrong IDs, of the cells that match.

    A cell is sending, motion, company and signal; None is any of `SENDINGS`, or any other.
    """
    total = np.zeros(3, dtype=int)
    for one in figures['cells']:
        own = one['sending'] in SENDINGS or cell[0] is not None
        wanted = zip(cell, _CELL, strict=False)
        if own and all(want is None or want == one[name] for want, name in wanted):
            total += (one['packets'], one['read'], one['wrong'])
    packets, read, wrong = total.tolist()
    return packets, read, wrong


def table(figures: dict[str, Any]) -> Table:
    """Return bright packets read and wrong IDs by company and motion."""
    rows = [[f'read of packets {_DB}, and wrong IDs', *MOTIONS]]
    for company in COMPANY:
        found = [counted(figures, None, motion, company, SIGNALS[-1]) for motion in MOTIONS]
        cells = [f'{_share(packets, read)}, {wrong}' for packets, read, wrong in found]
        rows.append([_COMPANY.get(company, company), *cells])
    return rows


def wrong_table(figures: dict[str, Any]) -> Table:
    """Return wrong IDs of all readings, and of those with the highest margin."""
    wrong, top = figures['wrong'], figures['by_margin'][-1]
    share = f'{wrong["rate"]:.2%}, at most {wrong["high"]:.2%}'
    return [
        ['', 'wrong', 'share (95 %)'],
        ['all readings', f'{wrong["hits"]} of {wrong["trials"]}', share],
        [f'margin of {top["margin"]:g} nats or more', f'{top["wrong"]} of {top["readings"]}', ''],
    ]


def place_table(figures: dict[str, Any]) -> Table:
    """Return errors of places by company and motion."""
    heads = ['right readings', 'range, half and nine tenths within', 'its standard deviation']
    heads += ['in its 95 % interval', 'place in the 95 % ellipsoid']
    rows = [['', *heads]]
    for one in figures['places']:
        if one['readings']:
            name = f'{_COMPANY.get(one["company"], one["company"])}, {_MOTIONS[one["motion"]]}'
            within = ['{:.1f}, {:.0f} mm'.format(*one[what]) for what in ('range_mm', 'stddev_mm')]
            holds = [percent(one[what]) for what in ('range_holds', 'ellipsoid_holds')]
            rows.append([name, str(one['readings']), *within, *holds])
    return rows


def _share(packets: int, read: int) -> str:
    return f'{read / packets:.0%}' if packets else NOTHING


def _message(figures: dict[str, Any]) -> str:
    cells = [counted(figures, None, motion, None, SIGNALS[-1]) for motion in MOTIONS]
    shares = [_share(packets, read) for packets, read, _ in cells]
    wrong = figures['wrong']
    return (
        f'Random rooms, bright markers: {shares[0]} of packets are read at rest, {shares[1]} '
        f'swaying, {shares[-1]} crossing; {wrong["hits"]} of {wrong["trials"]} readings are wrong'
    )


def draw(figures: dict[str, Any]) -> Any:
    """Draw a map for each motion, of sending against signal: what is read, and wrong IDs."""
    figure, panels = new_chart(3, 3, 4.6, _message(figures))
    for axis, motion in zip(panels, MOTIONS, strict=True):
        cells = np.array(
            [[counted(figures, one, motion, None, of) for of in SIGNALS] for one in SENDINGS]
        )
        shares = np.where(cells[..., 0], cells[..., 1] / np.maximum(cells[..., 0], 1), np.nan)
        axis.grid(visible=False)
        axis.imshow(shares, cmap='Blues', vmin=0, vmax=1, aspect='auto')
        for (y, x), share in np.ndenumerate(shares):
            packets, read, wrong = cells[y, x]
            how: dict[str, Any] = {'ha': 'center', 'va': 'center'}
            colour = 'white' if share > _DARK else 'black'
            few = {'fontweight': 'normal'} if packets < _FEW else {}
            axis.text(x, y - 0.2, _share(packets, read), color=colour, **(_BOLD | few), **how)
            axis.text(x, y + 0.08, f'of {packets}', color=colour, fontsize=9.5, **how)
            if wrong:
                box = {'facecolor': 'white', 'edgecolor': 'none', 'pad': 1.5}
                how |= {'color': WRONG_COLOUR, 'fontsize': 9.5, 'bbox': box}
                axis.text(x, y + 0.34, f'{wrong} wrong', **how)
        axis.set_title(_MOTIONS[motion], fontsize=11.5)
        axis.set_xticks(range(len(SIGNALS)), _SHORT_DB, fontsize=10.5)
        names = list(_SENDINGS.values()) if axis is panels[0] else [''] * len(SENDINGS)
        axis.set_yticks(range(len(SENDINGS)), names, fontsize=10.5)
    foreign = figures['wrong']['hits'] - counted(figures, None)[2]
    besides = f'besides, {foreign} wrong near markers of other kinds, or near none'
    figure.supxlabel(f'signal over noise [dB]\n{besides}', fontsize=11)
    return figure
