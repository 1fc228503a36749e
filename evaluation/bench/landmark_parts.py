# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each mechanism of landmarks buys: the same readings with all of them, and without one.

Prints a table: `embedded/run python -m evaluation.bench.landmark_parts [TRIALS]`.
"""

import itertools
import math
import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, suppress
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import numpy as np

from evaluation.bench import hand_trials as hand
from evaluation.bench import landmark_trials, places
from evaluation.bench.places import Look, PlaceError, held, place_error, rms
from evaluation.report.claims import markdown
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks import landmarks, least_squares, localization, reading
from retrolidar_ros.tasks.survey import Survey

_RARE = 16.266  # 99.9 % of a normal distribution in three dimensions
_SIDE_M, _POSE_M, _WRONG = 0.4, 0.002, 0.05
_MOVE_M = np.array([0.12, 0.1, 0.15])

Patch = tuple[object, str, object]


PARTS: Mapping[str, list[Patch]] = {
    'everything': [],
    'gating': [(landmarks, '_GATE', 20.0)],
    'moves': [(landmarks.Landmark, '_relocate', lambda *_: None)],
    'init': [],
    'shared': [(reading, '_SHARED', 0.0)],
    'student': [(least_squares, '_FREEDOM', 1e9)],
    'curvature': [(least_squares, '_curvature', lambda place, unit, range_m: 0 * range_m)],
    'second': [(least_squares, '_DISTINCT', math.inf)],
    'turns': [(least_squares, 'QUARTER_TURNS', least_squares.QUARTER_TURNS[:1])],
    'rot': [(landmarks, '_ROTATION_UNKNOWN', math.inf)],
    'clear': [(localization, '_CLEAR_M', math.inf), (localization, '_CLEAR', math.inf)],
    'acceleration that lasts': [(reading, '_LASTING_S', 0.1)],
    'time of all sensors': [(reading, '_SILENT_S', 1e-9)],
    'alikem': [(reading, '_ALIKE_M', 1e-6)],
}


class _Replayed:
    """What a sensor reads, simulated once: later runs get the same, in the same order."""

    def __init__(self) -> None:
        self._kept: list[tuple[list[Look], Mapping[str, Any]]] = []
        self.next = 0

    def __call__(self, scene: Scene, lasting_s: float, rng: np.random.Generator) -> Iterator[Look]:
        if self.next == len(self._kept):
            rows = [*_looks(scene, lasting_s, rng)]
            self._kept.append((rows, rng.bit_generator.state))
        rows, rng.bit_generator.state = self._kept[self.next]
        self.next += 1
        return iter(rows)


_looks = places.looks


def _errors(trials: int, rng: np.random.Generator, wrong: float, moved: bool) -> list[PlaceError]:
    """Return errors after each reading from four places; objects may be moved before the last."""
    world, rows = load_scene('coffee'), []
    ids = [one.id for one in world.markers]
    for _ in range(trials):
        poses = hand.hand_poses(world, _SIDE_M, rng)
        later = replace(
            world,
            markers=tuple(
                replace(one, position_m=tuple(np.array(one.position_m) + _MOVE_M))
                for one in world.markers
            ),
        )
        before = [hand.visit(pose, world, rng) for pose in poses]
        after = [hand.visit(pose, later, rng) for pose in poses[:2]] if moved else []
        groups = hand.hand_readings([*before, *after], rng, _POSE_M)
        survey = Survey({}, hand.errors_for(_POSE_M))
        for index, one in enumerate(groups):
            truths = [world] if index < 4 else [world, later]
            for each in one:
                if rng.random() < wrong:
                    each = each._replace(marker=int(rng.choice(ids)))
                with suppress(ValueError):
                    survey.take(str(each.marker), each)
                if moved and index < 4:
                    continue
                for found in survey.estimates():
                    errors = [
                        place_error(found, np.array(m.position_m))
                        for t in truths
                        for m in t.markers
                        if str(m.id) == found.name
                    ]
                    rows.append(
                        min(errors, key=lambda e: e.squared_distance)
                        if not (moved and index == 5 and each is one[-1])
                        else errors[-1]
                    )
    return rows


def _said(rows: list[PlaceError]) -> list[str]:
    sizes = [1e3 * row.position_m for row in rows]
    squared = np.array([row.squared_distance for row in rows])
    inside = np.mean(squared <= places.ELLIPSOID)
    return [
        f'{np.median(sizes):.1f}',
        f'{rms(sizes):.1f}',
        f'{100 * inside:.1f}',
        f'{100 * np.mean(squared > _RARE):.1f}',
        f'{len(rows)}',
    ]


def main() -> None:
    """Print the table."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 10

    def obj(rng):
        t = [landmark_trials.tilt_trial(math.radians(15), rng) for _ in range(3 * trials)]
        k = [x for x in t if x]
        return [f'{x:.2f}' for x in np.sqrt(np.mean(np.square(k), axis=0))[:2]] + [str(len(k))]

    def room(rng):
        t = [landmark_trials.room_trial(m, rng) for m in (3, 4) for _ in range(trials)]
        k = [x for x in t if x]
        return [
            f'{1e3 * rms([a for a, _ in k]):.1f}',
            f'{1e3 * max([a for a, _ in k]):.0f}',
            f'{math.degrees(rms([b for _, b in k])):.2f}',
            str(len(k)),
        ]

    def drone(rng):
        return _said(
            [row for _ in range(trials) for row in landmark_trials.drone_trial(3, rng)[3:]]
        )

    scen = {
        'hand': lambda r: _said(_errors(3 * trials, r, 0, False)),
        'wrong': lambda r: _said(_errors(3 * trials, r, _WRONG, False)),
        'moved': lambda r: _said(_errors(2 * trials, r, 0, True)),
        'tilt': obj,
        'room': room,
        'drone': drone,
    }
    kept = {name: _Replayed() for name in scen}
    for name in sys.argv[2:] or PARTS:
        with ExitStack() as stack:
            for target, attribute, value in PARTS[name]:
                stack.enter_context(patch.object(target, attribute, value))
            print(f'{name:20}', end=' ')
            for s, f in scen.items():
                k = kept[s]
                k.next = 0
                with patch.object(places, 'looks', k), patch.object(landmark_trials, 'looks', k):
                    print(s, *f(np.random.default_rng(7)), end=' | ', flush=True)
            print(flush=True)


if __name__ == '__main__':
    main()
