# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the paper's method reads, how often it reads a wrong ID, and what it sees in nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from retrolidar_ros.code import BIT_PERIOD_S, IDS, PACKET_BITS, PREAMBLE, packet
from retrolidar_ros.evaluation.detectors import new_detector
from retrolidar_ros.evaluation.reference import marker_in_each_zone
from retrolidar_ros.evaluation.statistics import rate
from retrolidar_ros.scene import Scene, Simulation

METHOD = 'paper'
PACKET_S = PACKET_BITS * BIT_PERIOD_S
SILENCE_S = 2.0  # before a marker wakes
PACKETS_IN_A_ROW = 10
NEVER_S = 1e9


def _read(scene: Scene, rng: np.random.Generator, duration_s: float) -> NDArray[np.int64]:
    """Return how many readings named the marker of their zone and how many another one.

    Shape (2, zones).
    """
    detector = new_detector(METHOD, scene.sensor.grid)
    own = {zone: marker.id for zone, marker in enumerate(scene.markers)}
    readings = np.zeros((2, scene.sensor.grid.zones), dtype=np.int64)
    for frame in Simulation(scene, rng).run(duration_s):
        for detection in detector.update(frame):
            zone = detection.zones[0]
            readings[0 if detection.id == own[zone] else 1, zone] += 1
    return readings


def _at_distance(range_m: float, scenes: int, rng: np.random.Generator) -> dict[str, Any]:
    """Read markers that wake for one packet, and markers that never pause."""
    woken = np.zeros(2, dtype=int)
    repeating = np.zeros(2, dtype=int)
    zones = 0
    for _ in range(scenes):
        lone = marker_in_each_zone(range_m, rng, start_s=(SILENCE_S, SILENCE_S + 0.5))
        woken += np.count_nonzero(_read(lone, rng, SILENCE_S + 0.5 + PACKET_S + 0.5), axis=-1)
        endless = marker_in_each_zone(range_m, rng, start_s=(0.0, PACKET_S), packets=None)
        readings = _read(endless, rng, (PACKETS_IN_A_ROW + 1) * PACKET_S)
        repeating += np.minimum(readings, PACKETS_IN_A_ROW).sum(axis=-1)
        zones += len(lone.markers)
    # A marker that starts late in the first packet's time completes ten packets and no more.
    packets = zones * PACKETS_IN_A_ROW
    return {
        'range_m': range_m,
        'woken': {
            'identified': rate(int(woken[0]), zones),
            'wrong': rate(int(woken[1]), zones),
        },
        'repeating': {
            'identified': rate(int(repeating[0]), packets),
            'wrong': rate(int(repeating[1]), packets),
        },
    }


def _silent(
    range_m: float, with_marker: bool, hours: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Watch markers that never send, or the bare wall."""
    scene = marker_in_each_zone(range_m, rng, start_s=(NEVER_S, NEVER_S))
    if not with_marker:
        scene = replace(scene, markers=())
    detector = new_detector(METHOD, scene.sensor.grid)
    false_ids = 0
    for block in Simulation(scene, rng).blocks(hours * 3600):
        for frame in block:
            false_ids += len(detector.update(frame))
    windows = round(hours * 3600 / PACKET_S) * scene.sensor.grid.zones
    return {
        'range_m': range_m,
        'with_marker': with_marker,
        'hours': hours,
        'false_detections': rate(min(detector.counts.candidates, windows), windows),
        'false_ids': false_ids,
    }


def _preambles_elsewhere() -> dict[str, Any]:
    """Return how near the repeated packets come to the preamble where it is not.

    Of every usable ID, over all other places in the cycle of 31 bits, the fewest bits that
    differ from the preamble: none makes the place as likely a start as the right one.
    """
    packets = packet(np.arange(1, IDS - 1))
    windows = np.stack(
        [np.roll(packets, -shift, axis=1)[:, : len(PREAMBLE)] for shift in range(1, PACKET_BITS)]
    )
    fewest = np.count_nonzero(windows != PREAMBLE, axis=-1).min(axis=0)
    return {'usable_ids': len(packets), 'by_fewest_differing_bits': np.bincount(fewest).tolist()}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return identification and wrong-ID rates over distance, and false alarms without marker."""
    ranges = [1.0, 2.0, 2.6] if quick else [round(1 + 0.2 * step, 1) for step in range(11)]
    silences = [(2.6, True)] if quick else [(r, True) for r in (1.0, 1.4, 1.8, 2.2, 2.6)]
    silences.append((2.6, False))
    scenes, hours = (2, 0.02) if quick else (64, 0.5)
    progress = tqdm(total=len(ranges) + len(silences), desc='reading', leave=False)
    by_range, silent = [], []
    with progress:
        for range_m in ranges:
            by_range.append(_at_distance(range_m, scenes, rng))
            progress.update()
        for range_m, with_marker in silences:
            silent.append(_silent(range_m, with_marker, hours, rng))
            progress.update()
    return {
        'method': METHOD,
        'by_range': by_range,
        'silent': silent,
        'preambles_elsewhere': _preambles_elsewhere(),
    }


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = ['range [m]   woken: read   wrong ID   repeating: read   wrong ID  (share of packets)']
    for row in figures['by_range']:
        woken, repeating = row['woken'], row['repeating']
        lines.append(
            f'{row["range_m"]:9.1f}  {woken["identified"]["rate"]:12.1%}  '
            f'{woken["wrong"]["rate"]:9.1%}  {repeating["identified"]["rate"]:16.1%}  '
            f'{repeating["wrong"]["rate"]:9.1%}'
        )
    lines.append('nothing sent             false detections a packet time and zone   false IDs')
    lines += [
        f'{"marker" if row["with_marker"] else "wall  "} at {row["range_m"]:.1f} m  '
        f'{row["false_detections"]["rate"]:45.3%}   '
        f'{row["false_ids"]} in {row["hours"]:g} h'
        for row in figures['silent']
    ]
    elsewhere = figures['preambles_elsewhere']
    none, one, *more = elsewhere['by_fewest_differing_bits']
    lines.append(
        f'of {elsewhere["usable_ids"]} usable IDs, {none} show a second preamble when repeated, '
        f'{one} all but one bit of it, {sum(more)} no more than all but two'
    )
    return '\n'.join(lines)


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw the rates over distance."""
    import matplotlib as mpl

    mpl.use('Agg')
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(8, 4.6), layout='constrained')
    ranges = [row['range_m'] for row in figures['by_range']]
    for mode, colour in (('woken', '#0072b2'), ('repeating', '#d55e00')):
        for kind, style in (('identified', '-'), ('wrong', '--')):
            rows = [row[mode][kind] for row in figures['by_range']]
            rates = [100 * row['rate'] for row in rows]
            label = f'{"right" if kind == "identified" else "wrong"} ID, {mode}'
            axes.plot(ranges, rates, style, color=colour, marker='o', markersize=4, label=label)
            low, high = ([100 * row[end] for row in rows] for end in ('low', 'high'))
            axes.fill_between(ranges, low, high, color=colour, alpha=0.15, linewidth=0)
    axes.axhline(80, color='0.6', linewidth=0.8)
    axes.axvline(2.6, color='0.6', linewidth=0.8)
    axes.annotate(
        "the paper's reach:\n80 % at 2.6 m",
        (2.6, 80),
        xytext=(8, 8),
        textcoords='offset points',
        fontsize=8,
        color='0.35',
    )
    axes.set_xlabel('distance of a 3 cm marker [m]')
    axes.set_ylabel('share of packets [%]')
    axes.set_ylim(0, 103)
    axes.set_title(f'Method {figures["method"]} on the reference scene', fontsize=11)
    axes.grid(alpha=0.3)
    axes.legend(loc='center left', fontsize=9)
    figure.savefig(path, dpi=120)
    plt.close(figure)
