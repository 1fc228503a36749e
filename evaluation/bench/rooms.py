# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Random rooms by which the detector is judged: `python -m evaluation.bench.rooms --seed 5`.

A seed that has been looked at is spent: figures are from seeds that no change was made by.
"""

import argparse
import json
import os
import sys
import time
from collections import Counter
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from evaluation.bench.rates import rate
from evaluation.bench.room_markers import FOREIGN, MOTIONS, SENDINGS
from evaluation.bench.room_scene import Room, RoomSimulation, draw_room
from evaluation.bench.room_truth import (
    COMPANY,
    SIGNALS,
    Scored,
    SentPacket,
    WrongReading,
    packets_of,
    score,
)
from retrolidar_ros.cli.processes import end_with_parent
from retrolidar_ros.detector import METHODS, create_detector

MARGINS = (0, 8, 10, 12, 15, 20, 25, 29.9)  # [nats]


class RoomResult(NamedTuple):
    """What became of a room of a seed."""

    room: int
    duration_s: float
    frames: int
    cpu_s: float  # of the detector
    foreign_s: float  # of all foreign markers
    scored: Scored


def play_room(
    number: int, room: Room, rng: np.random.Generator, method: str = METHODS[0], **options: Any
) -> RoomResult:
    """Read a room by a new detector, with options of `create_detector`."""
    simulation = RoomSimulation(room, rng)
    recording = simulation.run(room.scene.duration_s)
    detector = create_detector(method, recording.grid, bit_period_s=room.bit_period_s, **options)
    began_s = time.process_time()
    detections = detector.update_all(recording)
    cpu_s = time.process_time() - began_s
    foreign = sum(marker.sending in FOREIGN for marker in room.markers)
    return RoomResult(
        room=number,
        duration_s=room.scene.duration_s,
        frames=len(recording),
        cpu_s=cpu_s,
        foreign_s=foreign * room.scene.duration_s,
        scored=score(simulation, packets_of(simulation), detections),
    )


def play(number: int, seed: int, method: str = METHODS[0]) -> RoomResult:
    """Draw a room of a seed, and read it."""
    rng = np.random.default_rng([seed, number])
    return play_room(number, draw_room(rng), rng, method)


def play_all(
    rooms: Iterable[int], seed: int, processes: int = 1, method: str = METHODS[0]
) -> list[RoomResult]:
    """Play rooms of a seed, some at a time."""
    one = partial(play, seed=seed, method=method)
    if processes == 1:
        return list(map(one, rooms))
    parent = (os.getpid(),)
    with ProcessPoolExecutor(processes, get_context('spawn'), end_with_parent, parent) as pool:
        return list(pool.map(one, rooms, chunksize=4))


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
    frames = sum(result.frames for result in results)
    hours = sum(result.duration_s for result in results) / 3600
    cells = [
        {
            **dict(zip(('sending', 'motion', 'company', 'signal'), cell, strict=True)),
            'packets': packets[cell],
            'read': read[cell],
            'wrong': wrong[cell],
        }
        for cell in sorted({*packets, *wrong})
    ]
    return {
        'rooms': len(results),
        'hours': hours,
        'foreign_hours': sum(result.foreign_s for result in results) / 3600,
        'readings': len(readings),
        'wrong': rate(sum(not right for _, right in readings), max(len(readings), 1)),
        'wrong_per_hour': sum(not right for _, right in readings) / hours,
        'by_margin': [
            {
                'margin': margin,
                'readings': sum(found >= margin for found, _ in readings),
                'wrong': sum(found >= margin and not right for found, right in readings),
            }
            for margin in MARGINS
        ],
        'read': rate(sum(read.values()), max(sum(packets.values()), 1)),
        'misdated': sum(result.scored.misdated for result in results),
        'cpu_us_per_frame': 1e6 * sum(result.cpu_s for result in results) / max(frames, 1),
        'cells': cells,
        'wrong_ids': [
            {'room': result.room, **one._asdict()}
            for result in results
            for one in result.scored.wrong
        ],
    }


def report(figures: dict[str, Any]) -> str:
    """Return figures as text."""
    lines = []
    heads = [f'{company} {signal}' for company in COMPANY for signal in SIGNALS]
    lines.append('packets read / sent (wrong IDs)')
    lines.append(' ' * 20 + ''.join(f'{head:>17}' for head in heads) + f'{"wrong":>7}')
    rows = [(sending, motion) for sending in SENDINGS for motion in MOTIONS]
    keys = [(company, signal) for company in COMPANY for signal in SIGNALS]
    for row in [*rows, *((None, motion) for motion in MOTIONS), (None, None)]:
        texts = [_sum(figures, *row, *key) for key in keys]
        wrong = counted(figures, *row)[2]
        name = ' '.join(one or 'all' for one in row)
        lines.append(f'{name:20}' + ''.join(f'{text:>17}' for text in texts) + f'{wrong:7}')
    lines.append('')
    for sending in (*FOREIGN, ''):
        count = counted(figures, sending)[2]
        lines.append(f'wrong IDs near {f"foreign {sending}" if sending else "no marker"}: {count}')
    wrong, read = figures['wrong'], figures['read']
    total = (
        f'{figures["rooms"]} rooms, {figures["hours"]:.2f} h: {wrong["hits"]} of '
        f'{wrong["trials"]} readings wrong ({wrong["rate"]:.3%}, to {wrong["high"]:.3%}; '
        f'{figures["wrong_per_hour"]:.1f} an hour), {read["rate"]:.4f} of {read["trials"]} '
        f'packets read, {figures["misdated"]} right readings begin a packet early, '
        f'{figures["cpu_us_per_frame"]:.0f} µs a frame'
    )
    lines += [
        f'in {figures["foreign_hours"]:.2f} h of foreign markers',
        '',
        'margin [nats]  readings  wrong',
        *(
            f'{"≥":>8} {one["margin"]:4g}{one["readings"]:10}{one["wrong"]:7}'
            for one in figures['by_margin']
        ),
        '',
        total,
    ]
    if figures['wrong_ids']:
        names = list(figures['wrong_ids'][0])
        lines += ['', ' | '.join(names)]
        lines += [' | '.join(str(one[name]) for name in names) for one in figures['wrong_ids']]
    return '\n'.join(lines)


def _cell(one: SentPacket | WrongReading) -> tuple[str, str, str, str]:
    sending = one.sending if isinstance(one, SentPacket) else one.near
    return sending, one.motion, one.company, one.signal


def counted(figures: dict[str, Any], *cell: str | None) -> tuple[int, int, int]:
    """Return packets, how many were read, and wrong IDs, of the cells that begin so.

    A cell is sending, motion, company and signal; None is any of `SENDINGS`, or any other.
    """
    names = ('sending', 'motion', 'company', 'signal')
    total = np.zeros(3, dtype=int)
    for one in figures['cells']:
        own = one['sending'] in SENDINGS or cell[0] is not None
        wanted = zip(cell, names, strict=False)
        if own and all(want is None or want == one[name] for want, name in wanted):
            total += (one['packets'], one['read'], one['wrong'])
    packets, read, wrong = total.tolist()
    return packets, read, wrong


def _sum(figures: dict[str, Any], *cell: str | None) -> str:
    packets, read, wrong = counted(figures, *cell)
    if not packets and not wrong:
        return ''
    share = f'{read / packets:.3f}' if packets else '–'
    return f'{share} {packets}' + (f' ({wrong})' if wrong else '')


def main(arguments: list[str] | None = None) -> int:
    """Play rooms and print what became of them."""
    parser = argparse.ArgumentParser(prog='rooms', description=__doc__)
    parser.add_argument('--seed', type=int, required=True)
    parser.add_argument('--rooms', type=int, default=100, help='(default: %(default)s)')
    parser.add_argument('--first', type=int, default=0, help='the first of them')
    parser.add_argument('--processes', type=int, default=1, help='(default: %(default)s)')
    parser.add_argument('--method', choices=METHODS, default=METHODS[0])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    options = parser.parse_args(arguments)
    rooms = range(options.first, options.first + options.rooms)
    results = play_all(rooms, options.seed, options.processes, options.method)
    figures = summary(results)
    if options.json:
        options.json.write_text(json.dumps(figures, indent=1) + '\n', encoding='utf-8')
    print(report(figures))
    return 0


if __name__ == '__main__':
    os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
    sys.exit(main())
