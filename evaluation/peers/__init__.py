# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""LiDAR markers beside AprilTags and QR codes of the same size, at the same places."""

from __future__ import annotations

from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.rates import falls_below
from evaluation.peers.camera import Background
from evaluation.peers.chart import draw, draw_speed_accuracy
from evaluation.peers.claims import compare
from evaluation.peers.text import comment, summarise
from evaluation.peers.trials import (
    PACKET_S,
    PICTURES_OF_A_PACKET,
    TALKING,
    frame_cost,
    picture_cost,
    read_lidar,
    read_pictures,
)
from evaluation.peers.visual_markers import find_readers
from evaluation.report.charts import LEVEL
from retrolidar_ros.detector import METHODS

__all__ = [
    'SOURCE',
    'TITLE',
    'comment',
    'compare',
    'draw',
    'draw_speed_accuracy',
    'run',
    'summarise',
]

TITLE = 'LiDAR markers beside visual ones'
SOURCE = 'paper §6.3, Fig. 9 and 10'

_LUX = 300.0  # a room with its lamps on
_RANGES_M = {
    0.03: (0.5, 1.0, 1.2, 1.4, 1.7, 2.0, 2.4, 2.6, 2.8, 3.0, 3.3, 3.6, 4.0),
    0.01: (0.3, 0.4, 0.5, 0.6, 0.8, 0.9, 1.0, 1.1, 1.2, 1.4, 1.6, 1.8, 2.1),
}
_QUICK_RANGES_M = {0.03: (1.0, 2.0, 3.0), 0.01: (0.9,)}
_PICTURES, _QUICK_PICTURES = 80, 12
_SCENES, _QUICK_SCENES = 4, 1
_TIMED_PICTURES, _QUICK_TIMED_PICTURES = 3, 1
_TIMED_FRAMES, _QUICK_TIMED_FRAMES = 100, 50

# Light and glare are swept where all read nearly everything.
_SWEEP = {'range_m': 1.0, 'size_m': 0.03}
_LUXES = (300.0, 30.0, 10.0, 3.0, 1.7, 1.0, 0.6, 0.3, 0.1)
_QUICK_LUXES = (300.0, 1.0, 0.1)
_VEILS = (0.0, 0.2, 0.4, 0.6, 0.8, 0.9, 1.0, 1.1, 1.2)
_QUICK_VEILS = (0.0, 0.8, 1.2)
_GAMMA = 2.2  # of a usual picture


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return readings, errors and costs over distance, light and glare."""
    ranges_m = _QUICK_RANGES_M if quick else _RANGES_M
    luxes, veils = (_QUICK_LUXES, _QUICK_VEILS) if quick else (_LUXES, _VEILS)
    pictures = _QUICK_PICTURES if quick else _PICTURES
    scenes = _QUICK_SCENES if quick else _SCENES
    timed_pictures = _QUICK_TIMED_PICTURES if quick else _TIMED_PICTURES
    timed_frames = _QUICK_TIMED_FRAMES if quick else _TIMED_FRAMES
    readers, missing = find_readers()
    background = Background(rng)
    places: list[dict[str, Any]] = []
    wrong_in_whole = 0
    steps = sum(map(len, ranges_m.values())) + len(luxes) + len(veils)
    with tqdm(total=steps, desc='peers', leave=False) as progress:
        for size_m, distances in ranges_m.items():
            for range_m in distances:
                where = {'range_m': range_m, 'size_m': size_m}
                costs, wrong = picture_cost(
                    readers, background, timed_pictures, rng, lux=_LUX, **where
                )
                wrong_in_whole += wrong
                results = {
                    **read_lidar(range_m, size_m, scenes, rng),
                    **read_pictures(readers, background, pictures, rng, lux=_LUX, **where),
                }
                costs.update(frame_cost(range_m, size_m, TALKING, timed_frames, rng))
                places.append({**where, 'results': results, 'cpu_ms': costs})
                progress.update()
        lights = []
        for lux in luxes:
            results = read_pictures(readers, background, pictures, rng, lux=lux, **_SWEEP)
            lights.append({'lux': lux, 'results': results})
            progress.update()
        glares = []
        for veil in veils:
            results = read_pictures(
                readers, background, pictures, rng, lux=_LUX, veil=veil, **_SWEEP
            )
            glares.append({'veil': veil, 'results': results})
            progress.update()
    quiet_cpu_ms = frame_cost(_SWEEP['range_m'], _SWEEP['size_m'], 0, timed_frames, rng)
    curved = read_pictures(readers, background, pictures, rng, lux=_LUX, gamma=_GAMMA, **_SWEEP)
    names = [*METHODS, *(reader.name for reader in readers)]
    return {
        'methods': list(METHODS),
        'readers': [reader.name for reader in readers],
        'missing': missing,
        'lux': _LUX,
        'pictures': pictures,
        'packet_s': PACKET_S,
        'pictures_of_a_packet': PICTURES_OF_A_PACKET,
        'sweep': _SWEEP,
        'places': places,
        'lights': lights,
        'glares': glares,
        'gamma': {'gamma': _GAMMA, 'results': curved},
        'quiet_cpu_ms': quiet_cpu_ms,
        'reading': {name: _reading(name, places, quiet_cpu_ms.get(name)) for name in names},
        'wrong_in_whole_pictures': wrong_in_whole,
        'whole_pictures': len(places) * timed_pictures * len(readers),
    }


def _reading(name: str, places: list[dict[str, Any]], quiet_cpu_ms: float | None) -> dict[str, Any]:
    """Return what the points of one method or reader come to."""
    reach = {}
    for size_m in sorted({place['size_m'] for place in places}, reverse=True):
        curve = [place for place in places if place['size_m'] == size_m]
        ranges_m = [place['range_m'] for place in curve]
        results = [place['results'][name] for place in curve]
        single = [result['read']['rate'] for result in results]
        reach[f'{100 * size_m:.0f} cm'] = {
            'single': _reach_m(LEVEL, ranges_m, single),
            'single_half': _reach_m(0.5, ranges_m, single),
            'packet_time': _reach_m(
                LEVEL, ranges_m, [result['in_packet_time'] for result in results]
            ),
        }
    return {
        'reach_m': reach,
        'cpu_ms': float(np.median([place['cpu_ms'][name] for place in places])),
        'quiet_cpu_ms': quiet_cpu_ms,
        'wrong': sum(place['results'][name]['wrong'] for place in places),
    }


def _reach_m(level: float, ranges_m: list[float], shares: list[float]) -> float | None:
    """Return to what distance enough are read, at most the last; None = too few at the first."""
    if min(shares) >= level:
        return ranges_m[-1]
    return falls_below(level, ranges_m, shares)
