# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far markers of all sizes are read."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.link import Trial, lone_trial
from evaluation.bench.sweep import WAKING_S, reach, read_shares, told
from evaluation.experiments.link_budget import PAPER_EXPONENT, fit_line
from evaluation.report.charts import look, new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene.reference import marker_in_each_zone

TITLE = 'Size of the marker'
SOURCE = 'paper §6.4, Fig. 11a'
PAPER_REACH_M = {0.01: 1.3, 0.03: 2.6}
"""By the edge of the marker [m]."""
_EDGES_M = (0.01, 0.015, 0.02, 0.025, 0.03)
_QUICK_EDGES_M = (0.01, 0.03)
# Distances about where the link budget lets a marker of each size be read, over that of 3 cm.
_LIKE_M = (1.8, 2.0, 2.2, 2.4, 2.6, 2.8, 3.0, 3.2)
_QUICK_LIKE_M = (2.0, 2.6, 3.2)
_SCENES, _QUICK_SCENES = 6, 1


def _alike(range_m: float, edge_m: float) -> float:
    """Return where a marker is as bright as one of 3 cm at a range [m]."""
    return round(range_m * float((edge_m / 0.03) ** (-2 / PAPER_EXPONENT)), 3)


def lone(range_m: float, edge_m: float, rng: np.random.Generator) -> Trial:
    """Return lone packets of markers of a size [m]."""
    return lone_trial(marker_in_each_zone(range_m, rng, start_s=WAKING_S, size_m=edge_m), rng)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return shares of lone packets that are read, over size and distance."""
    edges_m, like_m, scenes = (
        (_QUICK_EDGES_M, _QUICK_LIKE_M, _QUICK_SCENES) if quick else (_EDGES_M, _LIKE_M, _SCENES)
    )
    sizes = []
    with tqdm(total=len(edges_m) * len(like_m), desc='size', leave=False) as progress:
        for edge_m in edges_m:
            points: list[dict[str, Any]] = []
            for like in like_m:
                range_m = _alike(like, edge_m)
                shares = read_shares(partial(lone, range_m, edge_m), scenes, rng)
                points.append({'range_m': range_m, **shares})
                progress.update()
            sizes.append(
                {
                    'size_m': edge_m,
                    'area_cm2': round(1e4 * edge_m**2, 4),
                    'points': points,
                    'reach_m': {method: reach(method, points) for method in METHODS},
                }
            )
    return {'sizes': sizes}


def summarise(figures: dict[str, Any]) -> str:
    """Return how far four of five are read, by size."""
    lines = ['80 % of lone packets are read to ' + ''.join(f'{method:>12}' for method in METHODS)]
    lines += [
        f'{row["area_cm2"]:8.2f} cm²                     '
        + ''.join(f'{told(row["reach_m"][method]):>12}' for method in METHODS)
        for row in figures['sizes']
    ]
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the reach of the smallest and the largest marker beside the paper's."""
    return [
        Claim(
            f'80 % of lone packets of {row["area_cm2"]:g} cm² are identified to',
            f'{PAPER_REACH_M[row["size_m"]]:g} m',
            *(told(row['reach_m'][method]) for method in reversed(METHODS)),
        )
        for row in figures['sizes']
        if row['size_m'] in PAPER_REACH_M
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say how reach grows with area."""
    known = [row for row in figures['sizes'] if row['reach_m']['joint']]
    exponent, _, _ = fit_line(
        np.log([row['area_cm2'] for row in known]),
        np.log([row['reach_m']['joint'] for row in known]),
    )
    small, large = PAPER_REACH_M.values()
    paper = np.log(large / small) / np.log(9)
    return (
        f'The reach of the default grows with area to the power {exponent:.2f}; the link budget '
        f'says 1/3.8 = {-1 / PAPER_EXPONENT:.2f} where noise does not change with the signal. The '
        f"paper's {small:g} and {large:g} m make {paper:.2f}: from {large:g} m its own law gives "
        f'{large * 9 ** (1 / PAPER_EXPONENT):.2f} m for 1 cm². A dash means that the method reads '
        'less than 80 % at the nearest distance: it mislocks near by as well (experiment '
        '`reading`).'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over distance for every size, and the reach over area."""
    figure, ((over, reaches),) = new_chart(1, 2, 15, 5)
    shades = np.linspace(0.35, 1, len(figures['sizes']))
    for row, shade in zip(figures['sizes'], shades, strict=True):
        for method in METHODS:
            over.plot(
                [point['range_m'] for point in row['points']],
                [100 * point[method]['right']['rate'] for point in row['points']],
                alpha=float(shade),
                **look(method),
            )
        last = row['points'][-1]
        over.annotate(
            f'{row["area_cm2"]:g} cm²',
            (last['range_m'], 100 * last['joint']['right']['rate']),
            xytext=(4, 4),
            textcoords='offset points',
            fontsize=9,
        )
    over.axhline(80, color='0.6', linewidth=0.8)
    over.set_ylim(-2, 103)
    over.set_xlabel('distance [m]')
    over.set_ylabel('lone packets identified [%]')
    for method in METHODS:
        known = [row for row in figures['sizes'] if row['reach_m'][method]]
        reaches.plot(
            [row['area_cm2'] for row in known],
            [row['reach_m'][method] for row in known],
            label=method,
            **look(method),
        )
    paper = [(1e4 * edge_m**2, reach_m) for edge_m, reach_m in PAPER_REACH_M.items()]
    reaches.plot(*zip(*paper, strict=True), 'kx', markersize=9, label="the paper's own")
    reaches.set_xlabel('area of the marker [cm²]')
    reaches.set_ylabel('80 % are read to [m]')
    reaches.set_ylim(0, None)
    reaches.legend(fontsize=10)
    figure.savefig(path)
