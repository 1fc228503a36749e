# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How well places are known from several places: objects, a tilted one, a drone, a robot."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from evaluation.bench import hand_trials as hand
from evaluation.bench.landmark_trials import FLIGHT_S, drone_trial, room_trial, tilt_trial
from evaluation.bench.places import PlaceError, held, place_error, rms
from evaluation.bench.rates import sum_of
from evaluation.peers.visual_markers import APRILTAG, find_readers
from evaluation.report.chart_style import (
    OTHERS,
    label,
    legend_below,
    legend_beside,
    line,
    look,
    new_chart,
)
from evaluation.report.claims import NOTHING, Table, percent
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.tasks.survey import Survey

TITLE = 'Landmarks: readings from several places'

_SIDES_M = (0.1, 0.2, 0.4, 0.6)
_REACH_M, _READY_M, _READY_S = 0.5, 0.01, 12.0
"""A hand that is to place all objects goes so far, until they are so well known, in such a time."""
_TAG_SIDE_M = 0.4
LIDAR = 'LiDAR marker'
_TRIALS, _QUICK_TRIALS = 20, 1  # of a hand that looks until all is known; others are dearer
_RARE = 16.266  # 99.9 % of a normal distribution in three dimensions
_POSE_M, _WRONG, _LATE = 0.002, 0.05, 0.10


def _errors(rows: list[PlaceError]) -> dict[str, Any]:
    squared = [row.squared_distance for row in rows]
    sizes = 1e3 * np.array([row.position_m for row in rows])
    return {
        'median_mm': float(np.median(sizes)),
        'rms_mm': rms(sizes),
        'stddev_mm': float(1e3 * np.median([row.stddev_m for row in rows])),
        'holds': held(squared),
        'beyond': int(np.count_nonzero(np.array(squared) > _RARE)),
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
            {'side_m': side_m, 'places': count, 'object': marker.name}
            | _errors(rows[count, marker])
            for count in range(1, len(hand.CORNERS) + 1)
            for marker in world.markers
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


def _stressed(world: Scene, trials: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return what wrong IDs, late transforms and wrong poses of the sensor do."""
    truth_m = {one.id: np.array(one.position_m) for one in world.markers}
    ids = list(truth_m)
    rows: list[PlaceError] = []
    for _ in range(trials):
        flat = [*itertools.chain(*hand.hand_readings(hand.visits(world, 0.4, rng), rng, _POSE_M))]
        for index, reading in enumerate(flat):
            if rng.random() < _WRONG:
                others = [one for one in ids if one != reading.marker]
                flat[index] = reading._replace(marker=int(rng.choice(others)))
        # A late transform lets a reading come after those of the next seconds.
        order = np.arange(len(flat)) + 4.0 * (rng.random(len(flat)) < _LATE)
        queue = [flat[index] for index in np.argsort(order, kind='stable')]
        survey = Survey({}, hand.errors_for(_POSE_M))
        for reading in queue:
            if reading.marker in truth_m:
                survey.take(str(reading.marker), reading)
                rows += [place_error(one, truth_m[int(one.name)]) for one in survey.estimates()]
    return _errors(rows)


def _room(markers: int, trials: int, rng: np.random.Generator) -> dict[str, Any]:
    """Return errors of a robot's pose among markers, and how often it was clear enough."""
    found = [room_trial(markers, rng) for _ in range(trials)]
    known = [one for one in found if one is not None]
    off_mm = [1e3 * off_m for off_m, _ in known]
    yaw_deg = [math.degrees(yaw) for _, yaw in known]
    return {
        'markers': markers,
        'trials': trials,
        'clear': len(off_mm),
        'rms_mm': rms(off_mm),
        'median_mm': float(np.median(off_mm)),
        'yaw_rms_deg': rms(yaw_deg),
    }


def _drone(sensors: int, trials: int, rng: np.random.Generator) -> dict[str, Any]:
    tracks = [drone_trial(sensors, rng) for _ in range(trials)]
    updates = float(np.mean([len(track) for track in tracks])) / FLIGHT_S
    rows = [row for track in tracks for row in track[3:]]
    return {'sensors': sensors, 'updates_per_s': updates} | _errors(rows)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return errors, times and coverage."""
    trials = _QUICK_TRIALS if quick else _TRIALS
    fewer = 1 if quick else 6
    world = load_scene('coffee')
    ready_s = [hand.ready_s(world, _READY_M, _REACH_M, rng) for _ in range(trials)]
    tilts = [tilt_trial(math.radians(15), rng) for _ in range(fewer)]
    known = [one for one in tilts if one is not None]
    return {
        'trials': trials,
        'places': _places(world, _SIDES_M[1:3] if quick else _SIDES_M, fewer, rng),
        'ready_s': sorted(round(one, 2) for one in ready_s if math.isfinite(one)),
        'tilt_deg': np.sqrt(np.mean(np.square(known), axis=0)).round(3).tolist(),
        'tags': [] if APRILTAG in find_readers()[1] else _beside_tags(world, fewer, rng),
        'drones': [_drone(one, 1 if quick else 4, rng) for one in (1, 2, 3)[:: 1 + quick]],
        'rooms': [_room(one, 2 if quick else 6, rng) for one in (3, 4, 5, 6)[:: 1 + 2 * quick]],
        'stress': _stressed(world, fewer, rng),
    }


def table(figures: dict[str, Any]) -> Table:
    """Return errors, and how often the 95 % ellipsoid holds."""
    rows = [['', 'median', 'rms', 'in the 95 % ellipsoid']]

    def joined(own: list[dict[str, Any]], key: str, digits: int = 0) -> str:
        return '/'.join(f'{row[key]:.{digits}f}' for row in own)

    def add(what: str, own: list[dict[str, Any]]) -> None:
        holds = [row['holds'] for row in own if 'holds' in row]
        sizes = [f'{joined(own, key, 1)} mm' for key in ('median_mm', 'rms_mm')]
        rows.append([what, *sizes, percent(sum_of(holds)) if holds else NOTHING])

    for side_m, count in ((0.2, 1), (0.2, 4), (0.4, 4)):
        places = figures['places']
        own = [row for row in places if (row['side_m'], row['places']) == (side_m, count)]
        where = 'one place' if count == 1 else f'4 places {side_m} m apart'
        add(f'{"/".join(row["object"] for row in own)} from {where}', own)
    for kind, pose_m in dict.fromkeys((row['kind'], row['pose_m']) for row in figures['tags']):
        own = [row for row in figures['tags'] if (row['kind'], row['pose_m']) == (kind, pose_m)]
        own.sort(key=lambda row: float(row['range_m']))
        tf = f'TF off by {1e3 * pose_m:g} mm and 0.2°' if pose_m else 'exact TF'
        add(f'the last, {kind}, {tf}', own)
    drones, rooms = figures['drones'], figures['rooms']
    sensors, updates = joined(drones, 'sensors'), joined(drones, 'updates_per_s', 1)
    add(f'drone before {sensors} sensors, {updates} updates a second', drones)
    what = f'robot among {joined(rooms, "markers")} markers, heading '
    what += f'{joined(rooms, "yaw_rms_deg", 1)}° rms, clear in {joined(rooms, "clear")}'
    add(f'{what} of {rooms[0]["trials"]}', rooms)
    sight, fixed, bound = figures['tilt_deg']
    within, stress = sum(one <= _READY_S for one in figures['ready_s']), figures['stress']
    ready = f'all three within {1e3 * _READY_M:g} mm in {_READY_S:g} s'
    others = {
        ready: f'{within} of {figures["trials"]}',
        'tilt of four markers on 20 cm, against the line of sight': f'{sight:.2f}°',
        'the same in the fixed frame': f'{fixed:.2f}°',
        'what zones and light leave open of that': f'{bound:.2f}°',
        'places beyond their 99.9 % ellipsoid, with wrong IDs, late and wrong poses': (
            f'{stress["beyond"]} of {stress["holds"]["trials"]}'
        ),
    }
    return rows + [[what, '', value, ''] for what, value in others.items()]


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
    figure, (baseline, number, beside) = new_chart(3, 2, 7.4, _message(figures))
    names = dict.fromkeys(row['object'] for row in figures['places'])
    looks = {name: line('-', one) for name, one in zip(names, OTHERS, strict=False)}
    for name, how in looks.items():
        own = [row for row in figures['places'] if row['object'] == name]
        for axis, key, chosen in (
            (baseline, 'side_m', [row for row in own if row['places'] == len(hand.CORNERS)]),
            (number, 'places', [row for row in own if row['side_m'] == 0.4]),
        ):
            at = [row[key] for row in chosen]
            axis.plot(at, [row['median_mm'] for row in chosen], **how | {'marker': 'o'})
            axis.plot(at, [row['stddev_mm'] for row in chosen], **how | {'linestyle': ':'})
    for kind, pose_m in dict.fromkeys((row['kind'], row['pose_m']) for row in figures['tags']):
        own = [row for row in figures['tags'] if (row['kind'], row['pose_m']) == (kind, pose_m)]
        own.sort(key=lambda row: float(row['range_m']))
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
    number.set_xticks(range(1, len(hand.CORNERS) + 1))
    baseline.axhline(10, **line('--', '0.4'), linewidth=1)
    number.axhline(10, **line('--', '0.4'), linewidth=1)
    if figures['tags']:
        legend_beside(beside)
    legend_below(figure, (), looks | {'estimated deviation': line(':')})
    return figure
