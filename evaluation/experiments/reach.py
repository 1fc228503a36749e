# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far the default method reads, in one packet, in three and in eight, and the paper's does."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.link import Trial, lone_trial
from evaluation.bench.sweep import WAKING_S, reach, read_shares, told
from evaluation.experiments.size import PAPER_REACH_M
from evaluation.report.charts import LEVEL, draw_shares, look, new_chart
from evaluation.report.claims import NOTHING, Claim
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import marker_in_each_zone
from retrolidar_ros.scene.truth import PACKET_S

TITLE = 'Reach over several packets'
SOURCE = ''

LOOK_S = 0.45  # after the last packet: when the next look at several of them is due, at the latest
PACKETS = (1, 3, 8)
_RANGES_M = {
    0.03: (1.0, 2.0, 2.4, 2.6, 2.7, 2.8, 3.0, 3.2, 3.3, 3.4, 3.6, 3.8, 4.0),
    0.01: (1.0, 1.3, 1.5, 1.6, 1.8, 2.0, 2.1, 2.2),
}
_QUICK_RANGES_M = {0.03: (1.0, 2.7, 3.3), 0.01: (1.5,)}
_SCENES, _QUICK_SCENES = 4, 1
_STYLES = {1: '-', 3: '--', 8: ':'}


def trial_at(range_m: float, size_m: float, packets: int, rng: np.random.Generator) -> Trial:
    """Return markers that wake for one packet, or that repeat it for a time of several."""
    if packets == 1:
        return lone_trial(marker_in_each_zone(range_m, rng, start_s=WAKING_S, size_m=size_m), rng)
    scene = marker_in_each_zone(range_m, rng, start_s=(-PACKET_S, 0.0), packets=None, size_m=size_m)
    return Trial(scene, Simulation(scene, rng).run(packets * PACKET_S + LOOK_S))


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return shares of right and wrong readings over distance, marker size and packets."""
    ranges = _QUICK_RANGES_M if quick else _RANGES_M
    scenes = _QUICK_SCENES if quick else _SCENES
    rows = []
    total = sum(map(len, ranges.values())) * len(PACKETS)
    with tqdm(total=total, desc='reach', leave=False) as progress:
        for size_m, places in ranges.items():
            for range_m in places:
                for packets in PACKETS:
                    shares = read_shares(
                        partial(trial_at, range_m, size_m, packets),
                        scenes,
                        rng,
                        max_packets=packets,
                    )
                    rows.append(
                        {'range_m': range_m, 'size_m': size_m, 'packets': packets, **shares}
                    )
                    progress.update()
    return {'points': rows, 'reach_m': _reaches(rows)}


def _curve(rows: list[dict[str, Any]], size_m: float, packets: int) -> list[dict[str, Any]]:
    return [row for row in rows if (row['size_m'], row['packets']) == (size_m, packets)]


def _reaches(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return to what distance four of five are read."""
    reaches = []
    for size_m in sorted({row['size_m'] for row in rows}, reverse=True):
        for packets in PACKETS:
            curve = _curve(rows, size_m, packets)
            found = {method: reach(method, curve) for method in METHODS}
            reaches.append({'size_m': size_m, 'packets': packets, **found})
    return reaches


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = ['marker  packets  range [m]   ' + '   '.join(f'{m}: right  wrong' for m in METHODS)]
    for row in figures['points']:
        shares = '   '.join(
            f'{row[method]["right"]["rate"]:{len(method) + 7}.1%} '
            f'{row[method]["wrong"]["rate"]:6.1%}'
            for method in METHODS
        )
        lines.append(
            f'{100 * row["size_m"]:4.0f} cm  {row["packets"]:7d}  {row["range_m"]:9.1f}   {shares}'
        )
    lines.append(f'{LEVEL:.0%} are read to')
    for row in figures['reach_m']:
        ends = ', '.join(f'{method} {told(row[method])}' for method in METHODS)
        lines.append(f'  {100 * row["size_m"]:.0f} cm, {row["packets"]} packets: {ends}')
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the reach of both sizes beside the paper's."""
    claims = []
    for row in figures['reach_m']:
        once = row['packets'] == 1
        packets = 'one packet' if once else f'{row["packets"]} packets'
        paper = f'{PAPER_REACH_M[row["size_m"]]:g} m' if once else NOTHING
        claims.append(
            Claim(
                f'{LEVEL:.0%} of markers of {100 * row["size_m"]:g} cm are read from {packets} to',
                paper,
                *(told(row[method]) for method in reversed(METHODS)),
            )
        )
    return claims


def comment(figures: dict[str, Any]) -> str:
    """Say what repeating brings."""
    wrong = {
        method: max(row[method]['wrong']['rate'] for row in figures['points']) for method in METHODS
    }
    return (
        'Packets of a marker that repeats are added up before they are decoded; the method of the '
        'paper has only more chances. The paper expects more than 99 % from three packets where '
        'one gives 80 %; that would need independent failures, and mislocks depend on the ID. The '
        'largest share of markers of '
        f'which a wrong ID was read: {wrong["joint"]:.1%} by `joint`, {wrong["paper"]:.0%} by '
        '`paper`.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over distance, a panel for each size of the marker."""
    sizes = sorted({row['size_m'] for row in figures['points']}, reverse=True)
    figure, (panels,) = new_chart(1, len(sizes), 12, 5)
    for axes, size_m in zip(panels, sizes, strict=True):
        for method in METHODS:
            for packets in PACKETS:
                curve = _curve(figures['points'], size_m, packets)
                draw_shares(
                    axes,
                    [row['range_m'] for row in curve],
                    [row[method]['right'] for row in curve],
                    linestyle=_STYLES[packets],
                    label=f'{method}, {packets} packet{"s" if packets > 1 else ""}',
                    **look(method),
                )
        axes.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
        axes.set_xlabel('distance [m]')
        axes.set_ylim(0, 103)
        axes.set_title(f'marker of {100 * size_m:.0f} cm', fontsize=11)
    panels[0].set_ylabel('markers read rightly [%]')
    panels[0].legend(fontsize=8, loc='lower left')
    figure.savefig(path)
