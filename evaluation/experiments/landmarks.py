# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How well objects are placed from several places, beside AprilTags.

Objects of several markers, drones and robots: `evaluation.bench.landmark_parts`.
"""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from evaluation.bench import hand_trials as hand
from evaluation.bench.places import PlaceError, median_mm
from evaluation.peers.visual_markers import APRILTAG
from evaluation.report import chart_style as charts
from evaluation.report.chart_style import label, line, look
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, load_scene

TITLE = 'Landmarks: readings from several places'

_SIDES_M = (0.1, 0.2, 0.4, 0.6)
_TAG_SIDE_M = 0.4
LIDAR = 'LiDAR marker'
_TRIALS = 6
_POSE_M = 0.002  # by which TF is off


def _errors(rows: list[PlaceError]) -> dict[str, Any]:
    return {
        'median_mm': median_mm([row.position_m for row in rows]),
        'stddev_mm': median_mm([row.stddev_m for row in rows]),
    }


def _places(
    world: Scene, sides_m: Sequence[float], trials: int, rng: np.random.Generator
) -> list[dict[str, Any]]:
    """Return errors of each object by distance of the places, and by how many of them."""
    found = []
    for side_m in sides_m:
        rows: dict[tuple[int, Marker], list[PlaceError]] = {}
        for _ in range(trials):
            readings = hand.hand_readings(hand.visits(world, side_m, rng), rng)
            for count in range(1, len(readings) + 1):
                taken = itertools.chain(*readings[:count])
                errors = hand.errors_after(taken, world, hand.errors_for(0.0))
                for marker, error in errors.items():
                    rows.setdefault((count, marker), []).append(error)
        found += [
            {'side_m': side_m, 'places': count, 'object': one.name, **_errors(rows[count, one])}
            for count, one in itertools.product(range(1, len(hand.CORNERS) + 1), world.markers)
        ]
    return found


def _beside_tags(world: Scene, trials: int, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Return errors of LiDAR markers and of AprilTags, all else alike, from four places."""
    camera = hand.TagCamera(rng)
    rows: dict[tuple[str, float, Marker], list[PlaceError]] = {}
    for _ in range(trials):
        trial = hand.visits(world, _TAG_SIDE_M, rng)
        for pose_m in (0.0, _POSE_M):
            ours = itertools.chain(*hand.hand_readings(trial, rng, pose_m))
            tags = camera.readings(trial, world, pose_m, rng)
            for kind, readings, errors in (
                (LIDAR, ours, hand.errors_for(pose_m)),
                (APRILTAG, tags, camera.errors(pose_m)),
            ):
                for marker, error in hand.errors_after(readings, world, errors).items():
                    rows.setdefault((kind, pose_m, marker), []).append(error)
    return [
        {'kind': kind, 'pose_m': pose_m, 'object': marker.name}
        | {'range_m': float(np.linalg.norm(marker.position_m))}
        | _errors(own)
        for (kind, pose_m, marker), own in rows.items()
    ]


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return errors of objects over the places they are seen from, and beside those of tags."""
    trials, world = 1 if quick else _TRIALS, load_scene('coffee')
    return {
        'places': _places(world, _SIDES_M[1:3] if quick else _SIDES_M, trials, rng),
        'tags': _beside_tags(world, trials, rng),
    }


def _message(figures: dict[str, Any]) -> str:
    corners = [row for row in figures['places'] if row['places'] == len(hand.CORNERS)]
    side_m = max(row['side_m'] for row in corners)
    worst_mm = max(row['median_mm'] for row in corners if row['side_m'] == side_m)
    words = f'Four places {side_m:g} m apart place objects to {worst_mm:.0f} mm'
    # The farthest object by kind, and by whether TF is off.
    farthest = sorted(figures['tags'], key=lambda row: float(row['range_m']))
    far_mm = {(row['kind'], bool(row['pose_m'])): row['median_mm'] for row in farthest}
    pairs = [[far_mm.get((kind, off)) for kind in (APRILTAG, LIDAR)] for off in (False, True)]
    if any(tag is None or own is None or tag >= own for tag, own in pairs):
        return words
    exact, off = (f'{tag:.1g} mm against {own:.0f} mm' for tag, own in pairs)
    where = f'at {farthest[-1]["range_m"]:.0f} m'
    return f'{words}; {where}, AprilTags win: {exact}, with TF off {off}'


def draw(figures: dict[str, Any]) -> Any:
    """Draw errors over the distance of the places, over their number, and beside those of tags."""
    figure, (baseline, number, beside) = charts.new_chart(3, 2, 7.4, _message(figures))
    names = dict.fromkeys(row['object'] for row in figures['places'])
    looks = {name: line('-', one) for name, one in zip(names, charts.OTHERS, strict=False)}
    for name, how in looks.items():
        own = [row for row in figures['places'] if row['object'] == name]
        for axis, key, chosen in (
            (baseline, 'side_m', [row for row in own if row['places'] == len(hand.CORNERS)]),
            (number, 'places', [row for row in own if row['side_m'] == 0.4]),
        ):
            at = [row[key] for row in chosen]
            axis.plot(at, [row['median_mm'] for row in chosen], **how | {'marker': 'o'})
            axis.plot(at, [row['stddev_mm'] for row in chosen], **how | {'linestyle': ':'})
    tags = sorted(figures['tags'], key=lambda row: float(row['range_m']))
    for kind, pose_m in dict.fromkeys((row['kind'], row['pose_m']) for row in figures['tags']):
        own = [row for row in tags if (row['kind'], row['pose_m']) == (kind, pose_m)]
        words = f'{kind}, ' + ('TF off by 2 mm, 0.2°' if pose_m else 'exact TF')
        style = look(APRILTAG if kind == APRILTAG else 'joint')
        style['linestyle'] = '--' if pose_m else '-'
        places = [row['range_m'] for row in own]
        beside.plot(places, [row['median_mm'] for row in own], label=words, **style)
    x, y = 'edge of the square it looks from [m]', 'error of the position [mm]'
    label(baseline, x, y, 'four places', yscale='log')
    label(number, 'places on a square of 0.4 m', y, 'one place after the other', yscale='log')
    what = 'beside tags, four places 0.4 m apart'
    label(beside, 'distance of the object [m]', y, what, yscale='log')
    for axis in (baseline, number, beside):
        axis.yaxis.set_major_formatter('{x:g}')
    for axis in (baseline, number):
        axis.axhline(10, **line('--', '0.4'), linewidth=1)
    number.set_xticks(range(1, len(hand.CORNERS) + 1))
    charts.legend_beside(beside)
    charts.legend_below(figure, (), looks | {'estimated deviation': line(':')})
    return figure
