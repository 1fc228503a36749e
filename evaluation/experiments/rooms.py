# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Random rooms: what is read, and what is read wrongly, by what was drawn."""

from typing import Any

import numpy as np

from evaluation.bench.room_markers import MOTIONS, SENDINGS
from evaluation.bench.room_truth import BRIGHT_DB, COMPANY, SIGNALS
from evaluation.bench.rooms import counted, play_all, summary
from evaluation.report.chart_style import WRONG_COLOUR, new_chart
from evaluation.report.claims import NOTHING, Table

TITLE = 'Random rooms'
ROOMS, QUICK_ROOMS = 300, 8
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
    """Return packets read and wrong IDs by all that was drawn."""
    return summary(play_all(range(QUICK_ROOMS if quick else ROOMS), int(rng.integers(2**32))))


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
        cells = [
            [counted(figures, sending, motion, None, one) for one in SIGNALS]
            for sending in SENDINGS
        ]
        shares = [
            [read / packets if packets else np.nan for packets, read, _ in row] for row in cells
        ]
        axis.grid(visible=False)
        axis.imshow(shares, cmap='Blues', vmin=0, vmax=1, aspect='auto')
        for (y, x), share in np.ndenumerate(shares):
            packets, read, wrong = cells[y][x]
            how: dict[str, Any] = {'ha': 'center', 'va': 'center'}
            colour = 'white' if share > _DARK else 'black'
            few = {'fontweight': 'normal'} if packets < _FEW else {}
            axis.text(x, y - 0.2, _share(packets, read), color=colour, **(_BOLD | few), **how)
            axis.text(x, y + 0.08, f'of {packets}', color=colour, fontsize=9.5, **how)
            if wrong:
                box = {'facecolor': 'white', 'edgecolor': 'none', 'pad': 1.5}
                axis.text(
                    x, y + 0.34, f'{wrong} wrong', color=WRONG_COLOUR, fontsize=9.5, bbox=box, **how
                )
        axis.set_title(_MOTIONS[motion], fontsize=11.5)
        axis.set_xticks(range(len(SIGNALS)), _SHORT_DB, fontsize=10.5)
        names = list(_SENDINGS.values()) if axis is panels[0] else [''] * len(SENDINGS)
        axis.set_yticks(range(len(SENDINGS)), names, fontsize=10.5)
    foreign = figures['wrong']['hits'] - counted(figures, None)[2]
    figure.supxlabel(
        'signal over noise [dB]; one packet needs 8 dB\n'
        f'besides, {foreign} wrong near markers of other kinds, or near none',
        fontsize=11,
    )
    return figure
