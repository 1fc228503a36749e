# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Brighter is surer: lone packets of dim to bright markers, under one stress after the other."""

from __future__ import annotations

import itertools
import time
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.rates import Rate, chance_of_fall, rate
from evaluation.bench.setup import Setup, arguments, setup_of, spread, told_rate
from evaluation.bench.stresses import STRESSES, Sent, Stress, record, snr_db

SIGNALS = (10.0, 15.0, 40.0, 150.0, 600.0)
"""Of the bright markers, without the wall [kcps/SPAD]."""
FALL_CHANCE = 0.01
"""A share that falls with a smaller chance than this, over all pairs of signals, is told."""
_WIDTH = 30
_POSSIBLE_DB = 8.0  # below this c over sigma a lone packet is not to be asked for


class Cell(NamedTuple):
    """One stress at one signal."""

    stress: Stress
    signal: float
    runs: int
    setup: Setup


class Counts(NamedTuple):
    """What became of the packets of a recording, or of several."""

    packets: int
    read: int
    """Packets of which the right ID was read in the right zone at the right time."""
    readings: int
    wrong: int
    """Readings of an ID that no marker has in the zones of the reading."""
    misplaced: int
    """Readings of a lone packet's ID that are half a packet or more from it."""
    frames: int
    detector_s: float
    """Processor time of the detector."""


def judged(sent: Sent, setup: Setup, **options: Any) -> Counts:
    """Play a recording to a new detector and compare what it reads with what was sent."""
    detector = setup.detector(sent.recording.grid, **options)
    began_s = time.process_time()
    detections = detector.update_all(sent.recording)
    detector_s = time.process_time() - began_s
    read = np.zeros(len(sent.ids), dtype=bool)
    wrong = misplaced = 0
    for detection in detections:
        zones = list(detection.zones)
        own = [zone for zone in zones if sent.ids[zone] == detection.id]
        if own:
            off_s = abs(detection.start_ns * 1e-9 - sent.start_s[own[0]])
            in_time = off_s < sent.packet_s / 2
            read[own[0]] |= in_time
            misplaced += not in_time
        elif sent.seconds is None or detection.id not in sent.seconds[zones]:
            wrong += 1
    return Counts(
        packets=len(read),
        read=int(read.sum()),
        readings=len(detections),
        wrong=wrong,
        misplaced=misplaced,
        frames=len(sent.recording),
        detector_s=detector_s,
    )


def added(counts: Sequence[Counts]) -> Counts:
    """Return the sums of counts."""
    return Counts(*(sum(column) for column in zip(*counts, strict=True)))


def measure(cell: Cell) -> Counts:
    """Return what became of all packets of a cell; its runs do not depend on other cells."""
    case = (STRESSES.index(cell.stress), round(cell.signal))
    return added(
        [
            judged(
                record(cell.stress, cell.signal, cell.setup.rng(*case, run), cell.setup.ids),
                cell.setup,
            )
            for run in range(cell.runs)
        ]
    )


def fall(rates: Sequence[Rate]) -> float:
    """Return the chance of the least likely fall from a signal to a brighter one, 0 to 1."""
    pairs = list(itertools.combinations(rates, 2))
    return min(1.0, len(pairs) * min((chance_of_fall(*pair) for pair in pairs), default=1.0))


def run(
    setup: Setup,
    *,
    runs: int,
    stresses: Sequence[Stress] = STRESSES,
    signals: Sequence[float] = SIGNALS,
    jobs: int = 1,
) -> dict[str, Any]:
    """Return shares of packets read and counts of wrong IDs, by stress and signal."""
    cells = [Cell(stress, signal, runs, setup) for stress in stresses for signal in signals]
    found = dict(zip(cells, spread(measure, cells, jobs), strict=True))
    rows = []
    for stress in stresses:
        counts = [found[Cell(stress, signal, runs, setup)] for signal in signals]
        rates = [rate(one.read, one.packets) for one in counts]
        rows.append(
            {
                'stress': stress.name,
                'read': rates,
                'snr_db': [snr_db(signal, stress.noise) for signal in signals],
                'counts': [one._asdict() for one in counts],
                'fall': fall(rates),
            }
        )
    total = added(list(found.values()))
    return {
        'runs': runs,
        'signals': list(signals),
        'rows': rows,
        'total': total._asdict(),
        'wrong': rate(total.wrong, total.readings) if total.readings else None,
        'detector_us_a_frame': 1e6 * total.detector_s / total.frames,
    }


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    signals = figures['signals']
    lines = [
        f'share of lone packets read (95 %) and wrong IDs/readings, {figures["runs"]} runs of 16',
        f'in brackets: c over sigma below {_POSSIBLE_DB:g} dB',
        f'{"bright signal":24}' + ''.join(f'{signal:>{_WIDTH}g}' for signal in signals),
    ]
    for row in figures['rows']:
        cells = []
        for share, counts, strength_db in zip(
            row['read'], row['counts'], row['snr_db'], strict=True
        ):
            told = f'{told_rate(share)} {counts["wrong"]}/{counts["readings"]}'
            cells.append(f'[{told}]' if strength_db < _POSSIBLE_DB else told)
        falls = f'  falls, p = {row["fall"]:.2g}' if row['fall'] < FALL_CHANCE else ''
        lines.append(f'{row["stress"]:24}' + ''.join(f'{cell:>{_WIDTH}}' for cell in cells) + falls)
    total, wrong = figures['total'], figures['wrong']
    share = f' = {told_rate(wrong)}' if wrong else ''
    lines.append(
        f'wrong IDs {total["wrong"]} of {total["readings"]} readings{share}, '
        f'{total["misplaced"]} readings half a packet off; '
        f'detector {figures["detector_us_a_frame"]:.0f} µs a frame over {total["frames"]} frames'
    )
    return '\n'.join(lines)


def main() -> None:
    """Run the experiment and print its table."""
    parser = arguments(__doc__, runs=2)
    parser.add_argument('--signals', type=float, nargs='+', default=SIGNALS)
    parser.add_argument('--only', metavar='TEXT', default='', help='stresses named so')
    told = parser.parse_args()
    chosen = [stress for stress in STRESSES if told.only in stress.name]
    figures = run(
        setup_of(told), runs=told.runs, stresses=chosen, signals=told.signals, jobs=told.jobs
    )
    print(summarise(figures))


if __name__ == '__main__':
    main()
