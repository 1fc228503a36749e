# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far markers may be turned away."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.link import Trial, lone_trial
from evaluation.bench.sweep import (
    WAKING_S,
    draw_reads,
    reach,
    read_shares,
    told,
)
from evaluation.report.charts import new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene.reference import marker_in_each_zone

TITLE = 'Yaw of the marker'
SOURCE = 'paper §6.4, Fig. 11b'
PAPER_GOOD_DEG, PAPER_DEAD_DEG = 50, 60
_YAWS_DEG = (0, 20, 40, 50, 52, 54, 56, 57, 58, 59, 60)
_QUICK_YAWS_DEG = (0, 50, 60)
_RANGES_M = (1.0, 2.0)
_SCENES, _QUICK_SCENES = 6, 1


def turned(range_m: float, yaw_deg: float, rng: np.random.Generator) -> Trial:
    """Return lone packets of markers that are turned by an angle from the line of sight."""
    scene = marker_in_each_zone(range_m, rng, start_s=WAKING_S)
    yaw_rad = math.radians(yaw_deg)
    markers = tuple(replace(marker, yaw_rad=yaw_rad) for marker in scene.markers)
    return lone_trial(replace(scene, markers=markers), rng)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return shares of lone packets that are read, over yaw, at two distances."""
    yaws_deg, scenes = (_QUICK_YAWS_DEG, _QUICK_SCENES) if quick else (_YAWS_DEG, _SCENES)
    ranges = []
    with tqdm(total=len(_RANGES_M) * len(yaws_deg), desc='yaw', leave=False) as progress:
        for range_m in _RANGES_M:
            points: list[dict[str, Any]] = []
            for yaw_deg in yaws_deg:
                shares = read_shares(partial(turned, range_m, yaw_deg), scenes, rng)
                points.append({'yaw_deg': yaw_deg, **shares})
                progress.update()
            limits = {method: reach(method, points, 'yaw_deg') for method in METHODS}
            ranges.append({'range_m': range_m, 'points': points, 'limit_deg': limits})
    return {'ranges': ranges}


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = []
    for row in figures['ranges']:
        lines.append(
            f'at {row["range_m"]:g} m, 80 % are read to '
            + ', '.join(f'{told(row["limit_deg"][m], "°", 1)} ({m})' for m in METHODS)
        )
        lines += [
            f'  {point["yaw_deg"]:3d}°  '
            + '   '.join(f'{m} {point[m]["right"]["rate"]:6.1%}' for m in METHODS)
            for point in row['points']
        ]
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the largest yaw beside the paper's."""
    return [
        Claim(
            f'80 % of lone packets are identified at {row["range_m"]:g} m to a yaw of',
            f'about ±{PAPER_GOOD_DEG}°' if row['range_m'] == 1.0 else 'not told',
            *(told(row['limit_deg'][method], '°', 1) for method in reversed(METHODS)),
        )
        for row in figures['ranges']
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say what of this is put in."""
    near = figures['ranges'][0]['limit_deg']['joint']
    return (
        f'The loss of light with yaw is put in: the projected area (cos yaw) to {PAPER_GOOD_DEG}°, '
        f'from there a straight line of ours to nothing at {PAPER_DEAD_DEG}°; the paper gives the '
        'two angles. What is measured is how much '
        'of that the methods bear. At 1 m there is light to spare, and the default reads to '
        f'{told(near, "°", 1)}. A dash means less than 80 % at no yaw, for the reasons given under '
        '`reading`.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over yaw, a panel for each distance."""
    figure, (panels,) = new_chart(1, len(figures['ranges']), 13, 4.8)
    for axis, row in zip(panels, figures['ranges'], strict=True):
        draw_reads(axis, row['points'], 'yaw_deg')
        axis.axvline(PAPER_GOOD_DEG, color='0.6', linewidth=0.8)
        axis.text(PAPER_GOOD_DEG - 0.6, 30, "paper's limit", color='0.35', rotation=90, ha='right')
        axis.set_xlabel('yaw [°]')
        axis.set_title(f'3 cm at {row["range_m"]:g} m', fontsize=12)
    panels[0].legend(fontsize=10, loc='center left')
    figure.savefig(path)
