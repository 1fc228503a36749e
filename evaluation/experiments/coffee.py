# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long a robot's arm takes until beans, machine and mug are placed (paper §7.1).

The hand looks from random places. An object whose range is off by more than a centimetre is looked
at again after another move, as the paper has it; so is one that was not placed. By tracks, the hand
stays a while longer, as they become better with every frame.
"""

import math
from typing import Any

import numpy as np

from evaluation.bench import places as hand
from evaluation.bench.judging import watch
from evaluation.peers.camera import PICTURES_HZ
from evaluation.peers.visual_markers import APRILTAG, AprilTagReader, read_over_distance
from evaluation.report.chart_style import label, line, look, new_chart
from evaluation.report.claims import BOTH_CLAIMED, Claim, Claims, Table, as_text, model
from retrolidar_ros.detector import create_detector
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.tasks.objects import ObjectBoard
from retrolidar_ros.tasks.reading import SensorPose

TITLE = 'Coffee arm'
TIMEOUT_S = 12.0
MAX_STDDEV_M, STALE_AFTER_S = 0.15, 10.0
"""How well an object must be placed, and how long a sighting counts."""
TOLERANCE_M = 0.01  # an object whose range is wrong by more is looked at again (paper §7.1)
MOVE_S = 3.0
PAPER_S, PAPER_SHARE = 5.3, 0.36
STAY_S = 1.0  # by tracks, after all are placed
WAYS = {'joint': 'packets', 'tracks': 'tracks', 'paper': "the paper's method"}
_TASKS = 2000  # drawn from the trials
_QUICK_TRIALS = 4

Outcome = tuple[float, dict[str, hand.PlaceError]]


def place_all(way: str, recording: Recording, scene: Scene, pose: SensorPose) -> Outcome:
    """Read frames until all markers of a scene are placed in the world, one of `WAYS`.

    Returns when the hand may go on from the first frame [s], infinite if it does not come; and the
    errors of the objects that were seen, as known then.
    """
    markers = {marker.id: marker for marker in scene.markers}
    board = ObjectBoard([one.name for one in markers.values()], MAX_STDDEV_M, STALE_AFTER_S)
    errors: dict[str, hand.PlaceError] = {}
    until_ns = math.inf
    by_tracks = way == 'tracks'
    detector = create_detector('paper' if way == 'paper' else 'joint', recording.grid)
    for step in watch(detector, recording, follow=by_tracks):
        now_ns = step.frame.stamp_ns
        for one in step.tracks if by_tracks else step.detections:
            marker = markers.get(one.id)
            if marker is None:
                continue
            covariance = pose.rotation @ one.place.covariance[:3, :3] @ pose.rotation.T
            position_m = hand.to_world(pose, one.place.position_m)
            board.see(marker.name, one.stamp_ns, 'world', position_m, covariance)
            errors[marker.name] = hand.place_error(one.place, np.array(marker.position_m))
        if math.isinf(until_ns) and not board.missing(now_ns):
            until_ns = now_ns + (1e9 * STAY_S if by_tracks else 0.0)
        if now_ns >= until_ns:
            return step.known_s, errors
    return math.inf, errors


def task_s(
    looks_s: list[float], good: list[list[bool]], rng: np.random.Generator
) -> dict[str, float]:
    """Return how long tasks take, and how many looks, if objects with errors are looked at again.

    Tasks are drawn from looks that took some time each [s], in which each object was placed well
    enough or not.
    """
    shares = np.array(good).mean(axis=0)
    # Each object by itself, as the paper counts: 3 · 0.36 / 0.64 = 1.7 looks more.
    again = rng.geometric(np.maximum(shares, 1e-3), (_TASKS, len(shares))) - 1
    cycles = 1 + again.sum(axis=1)
    times_s = cycles * (MOVE_S + rng.choice(looks_s, _TASKS))
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
        'look_s': float(np.mean(placed_s)) if placed_s else None,
        'range_mm': [1e3 * one.range_m for one in found],
        'bad': 1 - float(np.mean(good)),
        'by_range': task_s(looks_s, good, rng),
    }


def _tags(ranges_m: list[float], rng: np.random.Generator, quick: bool) -> dict[str, Any]:
    """Return the same of AprilTags at the places of the objects."""
    readers = [AprilTagReader()]
    places_m = np.quantile(ranges_m, np.linspace(0.05, 0.95, 7)).tolist()
    good, medians = [], []
    for found in read_over_distance(readers, places_m, int(rng.integers(2**31)), quick=quick):
        result, error = found[APRILTAG], found[APRILTAG]['error_mm']
        good.append(0.0 if error is None else result['right']['rate'] * (1 - error['above_1_cm']))
        medians += [] if error is None else [error['median']]
    drawn = rng.random((500, 3)) < float(np.mean(good))
    task = task_s([1 / PICTURES_HZ], drawn.tolist(), rng)
    median = float(np.median(medians)) if medians else None
    return {'bad': 1 - float(np.mean(good)), 'median_mm': median, **task}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return times and errors by packets and tracks from the same places, and of AprilTags."""
    trials = _QUICK_TRIALS if quick else 30
    world = load_scene('coffee')
    outcomes: dict[str, list[Outcome]] = {way: [] for way in WAYS}
    ranges_m: list[float] = []
    for _ in range(trials):
        pose = hand.random_pose(world, rng)
        scene = hand.view_from(pose, world, rng)
        recording = Simulation(scene, rng).run(TIMEOUT_S)
        ranges_m += np.linalg.norm(hand.markers_at(scene), axis=1).tolist()
        for way, rows in outcomes.items():
            rows.append(place_all(way, recording, scene, pose))
    names = [marker.name for marker in world.markers]
    papers = (rng.random((_TASKS, 3)) > PAPER_SHARE).tolist()
    return {
        'methods': {way: _lidar(rows, names, rng) for way, rows in outcomes.items()},
        'tags': _tags(ranges_m, rng, quick),
        'tags_of_the_paper': {'bad': PAPER_SHARE, **task_s([0.0], papers, rng)},
    }


def _looks(figures: dict[str, Any]) -> list[tuple[str, str, dict[str, Any]]]:
    """Return what looks at the objects, whose colour it has, and its figures."""
    methods, tags = figures['methods'], {'look_s': 1 / PICTURES_HZ}
    return [
        *((f'LiDAR, {WAYS[way]}', way, row | row['by_range']) for way, row in methods.items()),
        ('AprilTag in our pictures', APRILTAG, figures['tags'] | tags),
        ("AprilTag, the paper's 36 %", APRILTAG, figures['tags_of_the_paper'] | tags),
    ]


def _median_mm(row: dict[str, Any]) -> float | None:
    """Return the median error of range, if it is known."""
    found = row.get('range_mm')
    return float(np.median(np.abs(found))) if found else row.get('median_mm')


def table(figures: dict[str, Any]) -> Table:
    """Return the times of the whole task, moves included."""
    heads = ['', 'a look', 'range, median error', 'off by more than 1 cm', 'looks']
    rows = [[*heads, 'task in all, mean']]
    for name, kind, row in _looks(figures):
        look_s = row['look_s']
        time = as_text(1e3 * look_s, 'ms', 0) if kind == APRILTAG else as_text(look_s, 's', 1)
        task = (f'{row["bad"]:.0%}', f'{row["cycles"]:.1f}', f'{row["mean_s"]:.1f} s')
        rows.append([name, time, as_text(_median_mm(row), 'mm', 1), *task])
    return rows


def claims(figures: dict[str, Any]) -> Claims:
    """Return times and errors, to compare with the paper's."""
    both = [figures['methods'][method] for method in BOTH_CLAIMED]
    return {
        'task': Claim(*(as_text(row['by_range']['mean_s'], 's', 1) for row in both)),
        'tags': model(as_text(figures['tags_of_the_paper']['mean_s'], 's', 1)),
        'range': Claim(*(as_text(_median_mm(row), 'mm', 1) for row in both)),
    }


def draw(figures: dict[str, Any]) -> Any:
    """Draw how long the task takes, and errors of range, a bar for each way."""
    rows = [figures['methods'][way] for way in ('joint', 'tracks')]
    packets, tracks = (as_text(_median_mm(one), 'mm', 1) for one in rows)
    gain = f'by tracks, ranges are {tracks} off instead of {packets}'
    if packets == tracks:
        gain = f'ranges of packets and of tracks are {packets} off'
    title = (
        f'An arm places three objects in {rows[0]["by_range"]["mean_s"]:.1f} s; with tags, in '
        f'{figures["tags"]["mean_s"]:.1f} s; {gain}'
    )
    figure, (times, wrong) = new_chart(2, 2, 3.6, title)
    bars = _looks(figures)[::-1]
    for place, (_, kind, row) in enumerate(bars):
        for axis, value in ((times, row['mean_s']), (wrong, _median_mm(row))):
            axis.barh(place, value or 0.0, color=look(kind)['color'], height=0.6)
            box = {'facecolor': 'white', 'edgecolor': 'none', 'pad': 0.5}
            at = {'xy': (value or 0.0, place), 'xytext': (4, 0), 'textcoords': 'offset points'}
            axis.annotate(as_text(value, '', 1), **at, va='center', fontsize=11, bbox=box)
    times.axvline(PAPER_S, **line(':'))
    times.set_yticks(range(len(bars)), [words.removeprefix('LiDAR, ') for words, *_ in bars])
    wrong.set_yticks(range(len(bars)), [''] * len(bars))
    label(times, "whole task [s]; dotted: the paper's")
    label(wrong, 'median error of range [mm]')
    for axis in (times, wrong):
        axis.set_xlim(0, 1.13 * axis.get_xlim()[1])
    return figure
