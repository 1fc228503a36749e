# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long a robot's arm takes until beans, machine and mug are placed (paper §7.1).

The hand looks from random places. An object whose range is off by more than a centimetre is looked
at again after another move, as the paper has it; so is one that was not placed.
"""

import math
from typing import Any

import numpy as np

from evaluation.bench import places as hand
from evaluation.peers.camera import PICTURES_HZ
from evaluation.peers.visual_markers import APRILTAG, find_readers, read_over_distance
from evaluation.report.chart_style import (
    draw_distribution,
    label,
    legend_below,
    line,
    look,
    new_chart,
)
from evaluation.report.claims import BOTH_CLAIMED, Claims, Table, as_text, claim_of, model
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.tasks.objects import ObjectBoard
from retrolidar_ros.tasks.reading import SensorPose

TITLE = 'Coffee arm'
TIMEOUT_S = 12.0
MAX_STDDEV_M, STALE_AFTER_S = 0.15, 10.0
"""How well an object must be placed, and how long a sighting counts."""
TOLERANCE_M = 0.01  # an object whose range is wrong by more is looked at again (paper §7.1)
MOVE_S = 3.0
PAPER_S, PAPER_TAG_S, PAPER_SHARE = 5.3, 8.1, 0.36
_TASKS = 2000  # drawn from the trials
_QUICK_TRIALS = 4


Outcome = tuple[float, dict[str, hand.PlaceError]]


def place_all(method: str, recording: Recording, scene: Scene, pose: SensorPose) -> Outcome:
    """Read frames until all markers of a scene are placed in the world.

    Returns the time of that from the first frame [s], infinite if it does not come; and the errors
    of the objects that were seen.
    """
    markers = {marker.id: marker for marker in scene.markers}
    board = ObjectBoard([one.name for one in markers.values()], MAX_STDDEV_M, STALE_AFTER_S)
    errors: dict[str, hand.PlaceError] = {}
    for known_s, detection in hand.read_live(method, recording):
        marker = markers.get(detection.id)
        if marker is None:
            continue
        place = detection.place
        covariance = pose.rotation @ place.covariance[:3, :3] @ pose.rotation.T
        position_m = hand.to_world(pose, place.position_m)
        board.see(marker.name, detection.stamp_ns, 'world', position_m, covariance)
        errors[marker.name] = hand.place_error(place, np.array(marker.position_m))
        if not board.missing(int(recording.stamp_ns[0]) + round(1e9 * known_s)):
            return known_s, errors
    return math.inf, errors


def task_s(
    looks_s: list[float], good: list[list[bool]], rng: np.random.Generator, tasks: int = _TASKS
) -> dict[str, float]:
    """Return how long tasks take, and in how many looks, if what is bad is looked at again.

    Tasks are drawn from looks that took some time each [s], in which each object was placed well
    enough or not.
    """
    shares = np.array(good).mean(axis=0)
    # Each object by itself, as the paper counts: 3 · 0.36 / 0.64 = 1.7 looks more.
    again = rng.geometric(np.maximum(shares, 1e-3), (tasks, len(shares))) - 1
    cycles = 1 + again.sum(axis=1)
    times_s = cycles * (MOVE_S + rng.choice(looks_s, tasks))
    return {'cycles': float(cycles.mean()), 'mean_s': float(times_s.mean())}


def _lidar(outcomes: list[Outcome], names: list[str], rng: np.random.Generator) -> dict[str, Any]:
    placed_s = [time_s for time_s, _ in outcomes if math.isfinite(time_s)]
    looks_s = [min(time_s, TIMEOUT_S) for time_s, _ in outcomes]
    found = [error for _, errors in outcomes for error in errors.values()]
    good = [
        [name in errors and abs(errors[name].range_m) <= TOLERANCE_M for name in names]
        for _, errors in outcomes
    ]
    return {
        'looks_s': sorted(placed_s),
        'look_s': float(np.mean(placed_s)) if placed_s else None,
        'range_mm': [1e3 * one.range_m for one in found],
        'position_mm': [1e3 * one.position_m for one in found],
        'bad': 1 - float(np.mean(good)),
        'by_range': task_s(looks_s, good, rng),
    }


def _tags(ranges_m: list[float], rng: np.random.Generator, quick: bool) -> dict[str, Any] | None:
    """Return what AprilTags at the places of the objects come to; None without a reader."""
    readers = [one for one in find_readers()[0] if one.name == APRILTAG]
    if not readers:
        return None
    places_m, good = np.quantile(ranges_m, np.linspace(0.05, 0.95, 7)).tolist(), []
    for found in read_over_distance(readers, places_m, int(rng.integers(2**31)), quick=quick):
        result, error = found[APRILTAG], found[APRILTAG]['error_mm']
        good.append(0.0 if error is None else result['right']['rate'] * (1 - error['above_1_cm']))
    drawn = rng.random((500, 3)) < float(np.mean(good))
    return {'bad': 1 - float(np.mean(good)), **task_s([1 / PICTURES_HZ], drawn.tolist(), rng)}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return times and errors of both methods from the same places, and of AprilTags there."""
    trials = _QUICK_TRIALS if quick else 30
    world = load_scene('coffee')
    outcomes: dict[str, list[Outcome]] = {method: [] for method in METHODS}
    ranges_m: list[float] = []
    for _ in range(trials):
        pose = hand.random_pose(world, rng)
        scene = hand.view_from(pose, world, rng)
        recording = Simulation(scene, rng).run(TIMEOUT_S)
        ranges_m += np.linalg.norm(hand.markers_at(scene), axis=1).tolist()
        for method in METHODS:
            outcomes[method].append(place_all(method, recording, scene, pose))
    names = [marker.name for marker in world.markers]
    papers = (rng.random((_TASKS, 3)) > PAPER_SHARE).tolist()
    return {
        'trials': trials,
        'methods': {method: _lidar(rows, names, rng) for method, rows in outcomes.items()},
        'tags': _tags(ranges_m, rng, quick),
        'tags_of_the_paper': {'bad': PAPER_SHARE, **task_s([0.0], papers, rng)},
    }


def table(figures: dict[str, Any]) -> Table:
    """Return the times of the whole task, moves included."""
    rows = [['', 'a look', 'off by more than 1 cm', 'looks a task', 'task in all, mean']]
    looks = [
        (f'LiDAR, {method}', as_text(row['look_s'], 's', 1), row | row['by_range'])
        for method, row in figures['methods'].items()
    ]
    looks.append(('AprilTag in our pictures', '33 ms', figures['tags']))
    looks.append(("AprilTag, the paper's 36 %", '33 ms', figures['tags_of_the_paper']))
    for name, look_s, row in looks:
        if row is not None:
            task = (f'{row["bad"]:.0%}', f'{row["cycles"]:.1f}', f'{row["mean_s"]:.1f} s')
            rows.append([name, look_s, *task])
    return rows


def claims(figures: dict[str, Any]) -> Claims:
    """Set times and errors beside the paper's."""
    both = [figures['methods'][method] for method in BOTH_CLAIMED]
    task = both[1]['by_range']['mean_s']
    median = [float(np.median(np.abs(row['range_mm']))) for row in both if row['range_mm']]
    tags = figures['tags_of_the_paper']['mean_s']
    ours = None if figures['tags'] is None else figures['tags']['mean_s']
    times = (as_text(row['by_range']['mean_s'], 's', 1) for row in both)
    return {
        'task': claim_of(times, task <= PAPER_S + 0.5),
        'tags': model(f'{tags:.1f} s', abs(tags - PAPER_TAG_S) < 0.3),
        'our-tags': model(as_text(ours, 's', 1), ours is not None and ours > 7),
        'range': claim_of((as_text(one, 'mm', 1) for one in median), median[-1] < 10),
    }


def _message(figures: dict[str, Any]) -> str:
    row = figures['methods']['joint']
    if not row['range_mm']:
        return 'Nothing was placed'
    good, median = 1 - row['bad'], f'{float(np.median(row["position_mm"])):.0f} mm'
    return f'One look: {good:.0%} of ranges are good to a centimetre, positions to {median}'


def draw(figures: dict[str, Any]) -> Any:
    """Draw how long looks take, and errors of range and position."""
    figure, (times, wrong) = new_chart(2, 2, 4.6, _message(figures))
    for method, row in figures['methods'].items():
        colour = look(method)['color']
        ordered = 100 * np.arange(1, len(row['looks_s']) + 1) / figures['trials']
        times.step(row['looks_s'], ordered, where='post', color=colour)
        for key, style in (('range_mm', '-'), ('position_mm', '--')):
            sizes = np.maximum(np.abs(row[key]), 0.1)
            draw_distribution(wrong, sizes, color=colour, linestyle=style)
    times.axvline(PAPER_S - MOVE_S, **line(':'))
    wrong.axvline(1e3 * TOLERANCE_M, **line('-.'))
    label(times, 'from rest until all three are placed [s]', 'looks [%]', percent=True)
    label(wrong, 'error [mm]', 'objects [%]', percent=True, xscale='log')
    others = {
        'range': line('-'),
        'position': line('--'),
        "left: the paper's mean look": line(':'),
        'right: looked at again': line('-.'),
    }
    legend_below(figure, METHODS, others)
    return figure
