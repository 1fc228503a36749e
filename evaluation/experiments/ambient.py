# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far markers are read in the dark, in daylight and outdoors."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.link import Trial, lone_trial
from evaluation.bench.sweep import (
    WAKING_S,
    most_wrong,
    reach,
    read_shares,
    told,
)
from evaluation.experiments.link_budget import PAPER_EXPONENT
from evaluation.report.charts import look, new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL, marker_in_each_zone

TITLE = 'Ambient light'
SOURCE = 'paper §6.4, Fig. 11c'
PAPER_LOSS_M, PAPER_OUTDOORS_M = 0.2, 1.0
LIGHTS = {'dark': 0.0, 'lamps at night': 2.0, 'daylight in a room': 24.0, 'shade outdoors': 1000.0}
"""Ambient light at 940 nm as the sensor reports it [kcps/SPAD].

Public captures have 1 to 28 indoors; outdoors is forty times daylight in a room, as 20 000 lux
are to 500.
"""
_QUICK = ('dark', 'daylight in a room')
# Distances about where the noise of each light lets a marker be read, over those in the dark.
_LIKE_M = (1.8, 2.1, 2.4, 2.6, 2.8, 3.0, 3.2)
_QUICK_LIKE_M = (2.1, 2.6, 3.2)
_SCENES, _QUICK_SCENES = 8, 1
_DAZZLED = replace(NOISE, ambient=NOISE.slope)
_SENSOR = replace(SENSOR, noise=_DAZZLED)


def _alike(range_m: float, light: float) -> float:
    """Return where a marker stands out of the noise as it does in the dark at a range [m]."""
    dark = NOISE.floor + NOISE.slope * WALL_SIGNAL
    louder = (dark + _DAZZLED.ambient * light) / dark
    return round(range_m * float(louder ** (0.5 / PAPER_EXPONENT)), 3)


def lit(range_m: float, light: float, rng: np.random.Generator) -> Trial:
    """Return lone packets in ambient light [kcps/SPAD]."""
    scene = marker_in_each_zone(range_m, rng, start_s=WAKING_S, sensor=_SENSOR)
    return lone_trial(replace(scene, ambient=light), rng)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return shares of lone packets that are read, over light and distance."""
    names = _QUICK if quick else tuple(LIGHTS)
    like_m, scenes = (_QUICK_LIKE_M, _QUICK_SCENES) if quick else (_LIKE_M, _SCENES)
    lights: list[dict[str, Any]] = []
    with tqdm(total=len(names) * len(like_m), desc='ambient', leave=False) as progress:
        for name in names:
            light = LIGHTS[name]
            points: list[dict[str, Any]] = []
            for like in like_m:
                range_m = _alike(like, light)
                shares = read_shares(partial(lit, range_m, light), scenes, rng)
                points.append({'range_m': range_m, **shares})
                progress.update()
            lights.append(
                {
                    'light': name,
                    'ambient': light,
                    'points': points,
                    'reach_m': {method: reach(method, points) for method in METHODS},
                    'best': {
                        method: max(point[method]['right']['rate'] for point in points)
                        for method in METHODS
                    },
                }
            )
    return {'noise_a_light': _DAZZLED.ambient, 'lights': lights}


def summarise(figures: dict[str, Any]) -> str:
    """Return how far four of five are read, by light."""
    lines = ['80 % of lone packets are read to ' + ''.join(f'{method:>12}' for method in METHODS)]
    lines += [
        f'{row["light"]:20} {row["ambient"]:6g} kcps/SPAD'
        + ''.join(f'{told(row["reach_m"][method]):>12}' for method in METHODS)
        for row in figures['lights']
    ]
    return '\n'.join(lines)


def _reach(figures: dict[str, Any], light: str, method: str) -> float | None:
    found = [row['reach_m'][method] for row in figures['lights'] if row['light'] == light]
    return found[0] if found else None


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set what daylight costs beside the paper's."""
    losses = []
    for method in reversed(METHODS):
        dark, day = (_reach(figures, light, method) for light in _QUICK)
        losses.append(told(None if dark is None or day is None else dark - day))
    claims = [Claim('reach that daylight in a room costs', f'{PAPER_LOSS_M:g} m', *losses)]
    for row in figures['lights']:
        outdoors = row['light'] == 'shade outdoors'
        claims.append(
            Claim(
                f'80 % are read to, {row["light"]} ({row["ambient"]:g} kcps/SPAD)',
                f'over {PAPER_OUTDOORS_M:g} m' if outdoors else 'not told',
                *(told(row['reach_m'][method]) for method in reversed(METHODS)),
            )
        )
    return claims


def comment(figures: dict[str, Any]) -> str:
    """Say what is assumed, and that it was not fitted."""
    wrong = max(most_wrong('joint', row['points']) for row in figures['lights'])
    best = max(row['best']['paper'] for row in figures['lights'])
    return (
        'Ambient light is counted like signal: it adds its own shot noise, '
        f'{figures["noise_a_light"]:g} (kcps/SPAD)² for each kcps/SPAD, which is what a signal '
        'adds. Shot noise is physics, and this is not fitted; but that a kcps/SPAD of either adds '
        'the same noise assumes that both are counted in the same gate. If the sensor counts '
        'ambient light over its whole histogram, this is the upper end. Where the sensor itself '
        'gives up, as in direct sun, is not modelled. The default takes the noise to be expected '
        f'from the ambient light that comes with every frame; its wrong IDs: {wrong:.1%} at most. '
        'A dash means less than 80 % at the nearest distance; the most that the method of the '
        f'paper reads anywhere here is {best:.0%}.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over distance, a line for each light and method."""
    figure, (panels,) = new_chart(1, len(METHODS), 14, 4.8)
    shades = np.linspace(1, 0.35, len(figures['lights']))
    for axis, method in zip(panels, METHODS, strict=True):
        for row, shade in zip(figures['lights'], shades, strict=True):
            axis.plot(
                [point['range_m'] for point in row['points']],
                [100 * point[method]['right']['rate'] for point in row['points']],
                alpha=float(shade),
                label=f'{row["light"]}, {row["ambient"]:g} kcps/SPAD',
                **look(method),
            )
        axis.axhline(80, color='0.6', linewidth=0.8)
        axis.set_ylim(-2, 103)
        axis.set_xlim(0.3, None)  # room for the legend
        axis.set_xlabel('distance of a marker of 3 cm [m]')
        axis.set_ylabel('lone packets identified [%]')
        axis.set_title(method, fontsize=12)
        axis.legend(fontsize=9, loc='upper left', bbox_to_anchor=(0.02, 0.6))
    figure.savefig(path)
