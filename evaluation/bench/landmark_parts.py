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
from typing import Any
from unittest.mock import patch

import numpy as np

from evaluation.bench import hand_trials as hand
from evaluation.bench import places
from evaluation.bench.places import ELLIPSOID, PlaceError, place_error, rotation
from evaluation.report.claims import Table, markdown
from retrolidar_ros.detector import Detection
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, Wander, load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.scene.reference import RESPONSE, SENSOR
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import QUARTER_TURNS, matrix_of_turn
from retrolidar_ros.tasks import landmarks, least_squares, localization, next_view
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.localization import robot_pose, room_of
from retrolidar_ros.tasks.reading import Errors, KnownPose, Reading, SensorPose
from retrolidar_ros.tasks.survey import Survey

_SIDE_M, _POSE_M, _WRONG_IDS = 0.4, 0.002, 0.05
_MOVE_M = np.array([0.12, 0.1, 0.15])
_ROLL_RAD = math.radians(15)
_FAR_M = 0.2
_SEED = 7
_LOOKS = places.looks
_SURVEY_M = 0.002  # deviation of what is known of the places of markers on walls
CALIBRATED_M = 0.0005  # deviation of a sensor's range bias after a calibration
HEADINGS, STAY_S = 24, 1.6  # in how many directions a robot looks, and how long [s]
FLIGHT_S = 30.0
# Of the drone, with its assumed acceleration [m/s²/√Hz].
_FOLLOWED = Errors(range_bias_m=CALIBRATED_M, pose_m=1e-3, turn_rad=0.0035, acceleration=0.04)
_EXACT = Errors(range_bias_m=hand.BIAS_M, pose_m=1e-4, turn_rad=1e-4)
_SENSOR = replace(SENSOR, blur=0.05)
_HERE = SensorPose(np.zeros(3), np.eye(3))
# Directions of an optical frame in one whose z points up.
_UPRIGHT = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
_Look = tuple[float, Detection]


def world_of(places_m: Mapping[int, Floats], wander: Wander | None = None) -> Scene:
    """Return markers at places [m] by ID."""
    how: dict[str, Any] = {'response': RESPONSE, 'wander': wander}
    markers = (Marker(one, tuple(at_m), f'{one}', **how) for one, at_m in places_m.items())
    return Scene(sensor=_SENSOR, markers=tuple(markers))


def tilt_trial(roll_rad: float, rng: np.random.Generator) -> tuple[float, float] | None:
    """Let one place see four markers on 20 cm at 1 m, turned by up to some roll [rad].

    Returns errors of the tilt against the line of sight, and of the normal in the fixed frame [°].
    """
    corners = 0.2 * np.append(hand.CORNERS, np.zeros((4, 1)), axis=1)
    on_object = {1000 + 101 * n: corner for n, corner in enumerate(corners)}
    roll = matrix_of_turn(np.array([0, 0, rng.uniform(-roll_rad, roll_rad)]))
    way = rng.uniform(0, 2 * math.pi)
    tilt = rng.uniform(0, math.radians(30)) * np.array([math.cos(way), math.sin(way), 0])
    turned = matrix_of_turn(tilt) @ roll
    centre_m = np.append(rng.uniform(-0.1, 0.1, 2), 1.0)
    places_m = {one: centre_m + turned @ at for one, at in on_object.items()}
    trial = [hand.visit(_HERE, world_of(places_m), rng)]
    landmark = Landmark('object', on_object, _EXACT)
    for one in hand.hand_readings(trial, rng)[0]:
        if landmark.has(one.marker):
            landmark.take(one)
    estimate = landmark.estimate()
    if estimate is None:
        return None
    off = [
        np.degrees(np.arcsin(turn[:, :2].T @ (at / np.linalg.norm(at))))
        for turn, at in ((estimate.rotation, estimate.position_m), (turned, centre_m))
    ]
    cosine = float(estimate.rotation[:, 2] @ turned[:, 2])
    return (
        float(np.linalg.norm(off[0] - off[1])) / math.sqrt(2),
        math.degrees(math.acos(min(cosine, 1.0))),
    )


def drone_trial(rng: np.random.Generator) -> list[PlaceError]:
    """Follow a drone over three sensors on a triangle of 0.4 m that look up."""
    identity, height_m = 2127, float(rng.uniform(1.0, 1.5))
    wander = Wander(across_m=0.12, along_m=0.01, period_s=13.0)
    world = world_of({identity: np.array([0, 0, height_m])}, wander)
    rows: list[tuple[float, Reading]] = []
    clock = int(rng.integers(2**32))
    for index in range(3):
        angle, radius_m = 2 * math.pi * index / 3, 0.4 / math.sqrt(3)
        pose = SensorPose(radius_m * np.array([math.cos(angle), math.sin(angle), 0]), np.eye(3))
        # All sensors see the same marker, drawn from one generator.
        scene = places.view_from(pose, world, np.random.default_rng(clock))
        bias_m = float(rng.normal(0, CALIBRATED_M))
        for known_s, detection in places.looks(scene, FLIGHT_S, rng):
            if detection.id == identity:
                one = places.reading_of(detection, pose, bias_m=bias_m)
                rows.append((known_s, one._replace(sensor=str(index))))
    landmark, found = Landmark('drone', {identity: np.zeros(3)}, _FOLLOWED), []
    for _, one in sorted(rows, key=lambda row: row[0]):
        landmark.take(one)
        estimate = landmark.estimate()
        if estimate is not None:
            place_m = position_at(world.markers[0], np.array([estimate.stamp_s])).reshape(3)
            found.append(place_error(estimate, place_m))
    return found


def room_trial(rng: np.random.Generator) -> list[Floats]:
    """Let a robot in a room of 4 m turn on the spot, and locate it by three markers on the walls.

    Returns the errors of the places that it publishes, one after the other, shape (3,) [m].
    """
    base = SensorPose(np.append(rng.uniform(-0.5, 0.5, 2), 0.0), rotation(0, 0, rng.uniform(-3, 3)))
    on_walls: dict[int, Floats] = {}
    for index in range(3):
        angle = 2 * math.pi * (index + rng.uniform(-0.2, 0.2)) / 3
        way = np.array([math.cos(angle), math.sin(angle), 0])
        height_m = rng.uniform(-0.5, 0.5)
        on_walls[1000 + 101 * index] = 2 * way / np.abs(way).max() + [0, 0, height_m]
    known = {
        str(one): KnownPose(
            place + rng.normal(0, _SURVEY_M, 3),
            np.eye(3),
            np.diag([_SURVEY_M**2] * 3 + [1.0] * 3),
        )
        for one, place in on_walls.items()
    }
    world = world_of(on_walls)
    room = room_of(known, {str(one): {one: np.zeros(3)} for one in on_walls}, _EXACT, flat=True)
    bias_m = float(rng.normal(0, hand.BIAS_M))
    errors_m: list[Floats] = []
    for index in range(HEADINGS):
        heading = rotation(0, 0, 2 * math.pi * index / HEADINGS) @ _UPRIGHT
        pose = SensorPose(base.position_m, base.rotation @ heading)
        seen_from, since_s = SensorPose(np.zeros(3), heading), 100.0 * index
        for _, detection in places.looks(places.view_from(pose, world, rng), STAY_S, rng):
            if room.has(detection.id):
                room.take(places.reading_of(detection, seen_from, since_s=since_s, bias_m=bias_m))
                estimate = room.estimate()
                found = None if estimate is None else robot_pose(estimate, np.zeros(3), np.eye(3))
                if found is not None:
                    errors_m.append(found.position_m - base.position_m)
    return errors_m


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
    after = replace(
        before,
        markers=tuple(
            replace(one, position_m=tuple((one.position_m + _MOVE_M).tolist()))
            for one in before.markers
        ),
    )
    truth_m = {one.name: np.array(one.position_m) for one in (after if moved else before).markers}
    names = {one.id: one.name for one in before.markers}
    found = []
    for _ in range(trials):
        poses = hand.hand_poses(before, _SIDE_M, rng)
        trial = [hand.visit(pose, before, rng) for pose in poses]
        trial += [hand.visit(pose, after, rng) for pose in poses[:2]] if moved else []
        survey = Survey({}, hand.errors_for(_POSE_M))
        for group in hand.hand_readings(trial, rng, _POSE_M):
            for one in group:
                if not moved and rng.random() < _WRONG_IDS:
                    one = one._replace(marker=int(rng.choice([*names])))
                if one.marker not in names:
                    continue
                with suppress(ValueError):  # without gating some cannot be solved
                    survey.take(names[one.marker], one)
                if not moved:
                    rows = survey.estimates()
                    found += [place_error(row, truth_m[row.name]) for row in rows]
        if moved:
            found += [place_error(row, truth_m[row.name]) for row in survey.estimates()]
    return found


def _placed(rows: list[PlaceError]) -> list[str]:
    """Return the median and the largest error, and how many are in their 95 % ellipsoid."""
    inside = np.mean([row.squared_distance <= ELLIPSOID for row in rows])
    off_mm = 1e3 * np.array([row.position_m for row in rows])
    return [f'{np.median(off_mm):.1f} mm, {off_mm.max():.0f} mm, {inside:.1%}']


def _tilted(trials: int, rng: np.random.Generator) -> list[str]:
    """Return the median errors of an object's tilt against the line of sight, and of its normal."""
    found = [tilt_trial(_ROLL_RAD, rng) for _ in range(trials)]
    sight, fixed = np.median([one for one in found if one is not None], axis=0)
    return [f'{sight:.2f}°, {fixed:.1f}°']


def _located(trials: int, rng: np.random.Generator) -> list[str]:
    """Return a robot's median error among three markers, and how many poses were published.

    And how many of them were more than 0.2 m from the last one.
    """
    runs = [run for run in (room_trial(rng) for _ in range(trials)) if run]
    off_mm = [1e3 * np.linalg.norm(run[-1][:2]) for run in runs]
    far = [np.linalg.norm(one - run[-1]) > _FAR_M for run in runs for one in run]
    return [f'{np.median(off_mm):.0f} mm, {sum(far)} of {len(far)}']


def _flown(trials: int, rng: np.random.Generator) -> list[str]:
    return _placed([row for _ in range(trials) for row in drone_trial(rng)[3:]])


def _next_view(trials: int, rng: np.random.Generator, parts: bool) -> str:
    """Return how long a hand looks until three objects are placed, by best or by any places."""
    world = load_scene('coffee')

    def anywhere(_: object, middle_m: Floats, reach_m: float) -> Floats:
        found = next_view._places(middle_m, reach_m, (-math.inf, math.inf))
        one: Floats = found[rng.integers(len(found))]
        return one

    with patch.object(hand, 'best_place', next_view.best_place if parts else anywhere):
        found = [hand.ready_s(world, 0.01, 0.5, rng) for _ in range(trials)]
    return f'{np.median(found):.1f} s'


def table(trials: int) -> Table:
    """Return errors with all mechanisms, and without each of them."""
    cases: dict[str, Callable[[np.random.Generator], list[str]]] = {
        'objects: median, largest, in the 95 % ellipsoid': lambda rng: _placed(
            _objects(4 * trials, rng, moved=False)
        ),
        'after a move': lambda rng: _placed(_objects(trials, rng, moved=True)),
        'tilt against the line of sight, and in the fixed frame': lambda rng: _tilted(trials, rng),
        'robot: median, poses off by 0.2 m': lambda rng: _located(trials, rng),
        'drone': lambda rng: _flown(trials, rng),
    }
    replayed = {name: _Replayed() for name in cases}
    rows = [['without', *cases]]
    for part, patches in PARTS.items():
        cells = []
        for name, case in cases.items():
            looks = replayed[name]
            looks.next = 0
            with ExitStack() as stack:
                for target, attribute, value in patches:
                    stack.enter_context(patch.object(target, attribute, value))
                stack.enter_context(patch.object(places, 'looks', looks))
                cells += case(np.random.default_rng(_SEED))
        rows.append([part, *cells])
        print(*rows[-1], sep=' | ', file=sys.stderr, flush=True)
    return rows


def main() -> None:
    """Print the table, and what the choice of the next viewpoint buys."""
    trials = int(sys.argv[1]) if len(sys.argv) > 1 else 9
    print(markdown(table(trials)))
    best, anywhere = (
        _next_view(trials, np.random.default_rng(_SEED), one) for one in (True, False)
    )
    print(f'three objects within 10 mm: in {best} from the best places, in {anywhere} from any')


if __name__ == '__main__':
    main()
