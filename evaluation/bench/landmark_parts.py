# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each mechanism of landmarks buys: the same readings with all of them, and without one.

The trials are of objects on their own, an object of four markers, a drone, and a robot in a room.
Prints a table: `embedded/run python -m evaluation.bench.landmark_parts [TRIALS]`.
"""

import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from itertools import chain
from typing import Any
from unittest.mock import patch

import numpy as np

from evaluation.bench import hand_trials as hand
from evaluation.bench import places
from evaluation.bench.landmark_trials import drone_trial, room_trial, tilt_trial
from evaluation.bench.places import ELLIPSOID, PlaceError, place_error
from evaluation.report.claims import Table, markdown
from retrolidar_ros.detector import Detection
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import QUARTER_TURNS
from retrolidar_ros.tasks import landmarks, least_squares, localization, next_view
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.survey import Survey

_SIDE_M, _POSE_M, _WRONG_IDS = 0.4, 0.002, 0.05
_MOVE_M = np.array([0.12, 0.1, 0.15])
_ROLL_RAD = math.radians(15)
_FAR_M = 0.2
_SEED = 7
_LOOKS = places.looks
_Look = tuple[float, Detection]


def _white(before_s: Floats) -> Floats:
    """Return displacements as of an acceleration that is white, of the same spectral density."""
    apart_s = np.abs(before_s)
    least, most = np.minimum.outer(apart_s, apart_s), np.maximum.outer(apart_s, apart_s)
    white = least_squares._LASTING_S * least**2 * (most - least / 3)
    return np.where(np.outer(before_s, before_s) > 0, white, 0.0)


def _each_alone(_axes: Floats, _marker: Floats, _bearing: Floats, half: Floats) -> Floats:
    return np.ones_like(half)


def _flat(_place_m2: Floats, _unit: Floats, range_m: Floats) -> Floats:
    return np.zeros_like(range_m)


PARTS: Mapping[str, list[tuple[object, str, object]]] = {
    'nothing': [],
    'gating': [(landmarks, '_GATE', math.inf)],
    'restart after a move': [(Landmark, '_relocate', lambda *_: None)],
    'initialisation by two readings': [(landmarks, '_AGREEING', 0)],
    'vague ranges left out': [(landmarks, '_VAGUE_M', math.inf)],
    'errors shared by a place': [(least_squares, '_SHARED', 0.0)],
    'like directions once': [(least_squares, '_redundancy', _each_alone)],
    'curvature of ranges': [(least_squares, '_curvature', _flat)],
    '24 initial guesses': [(least_squares, 'QUARTER_TURNS', QUARTER_TURNS[:1])],
    'guesses until the rotation is known': [(landmarks, '_ROTATION_UNKNOWN', math.inf)],
    'no pose while unclear': [(localization, '_CLEAR_M', math.inf), (localization, '_CLEAR', 99)],
    'acceleration that lasts': [(least_squares, '_wandered', _white)],
    'time of all sensors': [(least_squares, '_SILENT_S', 1e-9)],
}


class _Replayed:
    """What a sensor reads, simulated once: later runs get the same, in the same order."""

    def __init__(self) -> None:
        self._kept: list[tuple[list[_Look], Mapping[str, Any]]] = []
        self.next = 0

    def __call__(self, scene: Scene, lasting_s: float, rng: np.random.Generator) -> Iterator[_Look]:
        if self.next == len(self._kept):
            rows = [*_LOOKS(scene, lasting_s, rng)]
            self._kept.append((rows, rng.bit_generator.state))
        rows, rng.bit_generator.state = self._kept[self.next]
        self.next += 1
        return iter(rows)


def _objects(trials: int, rng: np.random.Generator, *, moved: bool) -> list[PlaceError]:
    """Return errors after each reading from four places, a few with a wrong ID.

    Or errors of objects that were moved after that, and were read from two places since.
    """
    before = load_scene('coffee')
    moved_m = [tuple((one.position_m + _MOVE_M).tolist()) for one in before.markers]
    pairs = zip(before.markers, moved_m, strict=True)
    after = replace(before, markers=tuple(replace(one, position_m=at_m) for one, at_m in pairs))
    truth_m = {one.name: np.array(one.position_m) for one in (after if moved else before).markers}
    names = {one.id: one.name for one in before.markers}
    found = []
    for _ in range(trials):
        poses = hand.hand_poses(before, _SIDE_M, rng)
        trial = [hand.visit(pose, before, rng) for pose in poses]
        trial += [hand.visit(pose, after, rng) for pose in poses[:2]] if moved else []
        survey = Survey({}, hand.errors_for(_POSE_M))
        for one in chain(*hand.hand_readings(trial, rng, _POSE_M)):
            if not moved and rng.random() < _WRONG_IDS:
                one = one._replace(marker=int(rng.choice([*names])))
            if one.marker not in names:
                continue
            with suppress(ValueError):  # without gating some cannot be solved
                survey.take(names[one.marker], one)
            if not moved:
                found += [place_error(row, truth_m[row.name]) for row in survey.estimates()]
        if moved:
            found += [place_error(row, truth_m[row.name]) for row in survey.estimates()]
    return found


def _placed(rows: list[PlaceError]) -> str:
    """Return the median and the largest error, and how many are in their 95 % ellipsoid."""
    inside = np.mean([row.squared_distance <= ELLIPSOID for row in rows])
    off_mm = 1e3 * np.array([row.position_m for row in rows])
    return f'{np.median(off_mm):.1f} mm, {off_mm.max():.0f} mm, {inside:.1%}'


def _tilted(trials: int, rng: np.random.Generator) -> str:
    """Return the median errors of an object's tilt against the line of sight, and of its normal."""
    found = [tilt_trial(_ROLL_RAD, rng) for _ in range(trials)]
    sight, fixed = np.median([one for one in found if one is not None], axis=0)
    return f'{sight:.2f}°, {fixed:.1f}°'


def _located(trials: int, rng: np.random.Generator) -> str:
    """Return a robot's median error among three markers, and how many poses were published.

    And how many of them were more than 0.2 m from the last one.
    """
    runs = [run for run in (room_trial(rng) for _ in range(trials)) if run]
    off_mm = [1e3 * np.linalg.norm(run[-1][:2]) for run in runs]
    far = [np.linalg.norm(one - run[-1]) > _FAR_M for run in runs for one in run]
    return f'{np.median(off_mm):.0f} mm, {sum(far)} of {len(far)}'


def _next_view(trials: int, best: bool) -> str:
    """Return how long a hand looks until three objects are placed, by best or by any places."""
    world, rng = load_scene('coffee'), np.random.default_rng(_SEED)

    def anywhere(_: object, middle_m: Floats, reach_m: float) -> Floats:
        found = next_view._places(middle_m, reach_m, (-math.inf, math.inf))
        one: Floats = found[rng.integers(len(found))]
        return one

    with patch.object(hand, 'best_place', next_view.best_place if best else anywhere):
        found = [hand.ready_s(world, 0.01, 0.5, rng) for _ in range(trials)]
    return f'{np.median(found):.1f} s'


def table(trials: int) -> Table:
    """Return errors with all mechanisms, and without each of them."""
    cases: dict[str, Callable[[np.random.Generator], str]] = {
        'objects: median, largest, in the 95 % ellipsoid': lambda rng: _placed(
            _objects(4 * trials, rng, moved=False)
        ),
        'after a move': lambda rng: _placed(_objects(trials, rng, moved=True)),
        'tilt against the line of sight, and in the fixed frame': lambda rng: _tilted(trials, rng),
        'robot: median, poses off by 0.2 m': lambda rng: _located(trials, rng),
        'drone': lambda rng: _placed([one for _ in range(trials) for one in drone_trial(rng)[3:]]),
    }
    replayed = {name: _Replayed() for name in cases}
    rows = [['without', *cases]]
    for part, patches in PARTS.items():
        rows.append([part])
        for name, case in cases.items():
            looks = replayed[name]
            looks.next = 0
            with ExitStack() as stack:
                for target in (*patches, (places, 'looks', looks)):
                    stack.enter_context(patch.object(*target))
                rows[-1].append(case(np.random.default_rng(_SEED)))
        print(*rows[-1], sep=' | ', file=sys.stderr, flush=True)
    return rows


def main() -> None:
    """Print the table, and what the choice of the next viewpoint buys."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    print(markdown(table(trials)))
    best, anywhere = (_next_view(trials, one) for one in (True, False))
    print(f'three objects within 10 mm: in {best} from the best places, in {anywhere} from any')


if __name__ == '__main__':
    main()
