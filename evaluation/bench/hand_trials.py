# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of a hand that looks at objects from several places, and what landmarks make of it."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from evaluation.bench import places
from evaluation.bench.places import Look, PlaceError
from retrolidar_ros.scene import Scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.next_view import best_place
from retrolidar_ros.tasks.reading import Errors, Reading, SensorPose

CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) / 2
BIAS_M = 0.002  # deviation of a sensor's range bias
VISIT_S, _MOST_READINGS = 4.3, 3  # of each place, and of one marker there
_HAND_M, _ROLL_RAD = 0.15, 0.6
_AIM_RAD = math.radians(3)
_STAY_S, _MOST_PLACES = 2.2, 16
"""How long a hand waits for what is missing at a place, and when it gives up."""


def aim(
    place_m: Floats, targets_m: Floats, roll: float, world: Scene, rng: np.random.Generator
) -> SensorPose | None:
    """Return a hand that sees all targets, shape (n, 3) [m], about in its middle, if it can.

    It is at a place, shape (3,) [m], with a roll to 3° more or less [rad].
    """
    for _ in range(100):
        turns = np.array([0, 0, roll]) + rng.uniform(-_AIM_RAD, _AIM_RAD, 3)
        pose = places.towards(targets_m.mean(axis=0), place_m, turns)
        if places.sees_all(places.to_sensor(pose, targets_m), world.sensor.grid):
            return pose
    return None


def hand_poses(world: Scene, side_m: float, rng: np.random.Generator) -> list[SensorPose]:
    """Return the hand at the corners of a square, all markers in view of each."""
    while True:
        centre_m, roll = rng.uniform(-_HAND_M, _HAND_M, 3), rng.uniform(-_ROLL_RAD, _ROLL_RAD)
        turned = places.rotation(0, 0, rng.uniform(0, 2 * math.pi))
        corners = centre_m + side_m * np.append(CORNERS, np.zeros((4, 1)), axis=1) @ turned.T
        found = [aim(place_m, places.markers_at(world), roll, world, rng) for place_m in corners]
        poses = [pose for pose in found if pose is not None]
        if len(poses) == len(CORNERS):
            return poses


class Visit(NamedTuple):
    """One place of the hand, and what it read there, in order."""

    pose: SensorPose
    looks: list[Look]


def visits(world: Scene, side_m: float, rng: np.random.Generator) -> list[Visit]:
    """Let the hand stay at each corner of a square."""
    return [
        Visit(
            pose,
            list(
                places.looks(places.view_from(pose, world.markers, world.sensor, rng), VISIT_S, rng)
            ),
        )
        for pose in hand_poses(world, side_m, rng)
    ]


def hand_readings(
    trial: Sequence[Visit], rng: np.random.Generator, pose_m: float = 0.0
) -> list[list[Reading]]:
    """Return readings by place of the hand, at most `_MOST_READINGS` of one marker at each.

    The range has a random bias; TF is off by a deviation of `pose_m` [m].
    """
    bias_m = float(rng.normal(0, BIAS_M))
    found = []
    for index, visit in enumerate(trial):
        pose = places.pose_of_tf(visit.pose, pose_m, rng)
        count: Counter[int] = Counter()
        rows = []
        for _, detection in visit.looks:
            count[detection.id] += 1
            if count[detection.id] <= _MOST_READINGS:
                rows.append(
                    places.reading_of(detection, pose, since_s=100.0 * index, bias_m=bias_m)
                )
        found.append(rows)
    return found


def errors_for(pose_m: float) -> Errors:
    """Return the errors that landmarks assume in a trial."""
    return Errors(range_bias_m=BIAS_M, pose_m=max(pose_m, 1e-4), turn_rad=max(1.75 * pose_m, 1e-4))


def landmarks_for(ids: Sequence[int], errors: Errors) -> dict[int, Landmark]:
    """Return landmarks of lone markers, by their IDs."""
    return {one: Landmark(str(one), {one: np.zeros(3)}, errors) for one in ids}


def take_all(landmarks: Mapping[int, Landmark], readings: Iterable[Reading]) -> None:
    """Let landmarks take the readings of their markers."""
    for reading in readings:
        if reading.marker in landmarks:
            landmarks[reading.marker].take(reading)


def errors_of(landmarks: Mapping[int, Landmark], world: Scene) -> dict[int, PlaceError]:
    """Return by how much the landmarks that are known are wrong, by the IDs of their markers."""
    known = {one.id: (one, landmarks[one.id].estimate()) for one in world.markers}
    return {
        identity: places.place_error(estimate, np.array(marker.position_m))
        for identity, (marker, estimate) in known.items()
        if estimate is not None
    }


def ready_s(world: Scene, wanted_m: float, reach_m: float, rng: np.random.Generator) -> float:
    """Return how long a hand looks until all objects are known [s], infinite if it gives up.

    It goes to where it learns most each time.

    It leaves a place when every object that is not known yet and is in view has been read there,
    or does not come. If it cannot see all of those at once, it looks at the one known least. Known
    is what has a deviation of `wanted_m` along its worst axis [m]; the hand can go `reach_m` from
    where it looks first [m].
    """
    truth_m = dict(zip((one.id for one in world.markers), places.markers_at(world), strict=True))
    landmarks = landmarks_for(list(truth_m), errors_for(0.0))
    bias_m, roll = float(rng.normal(0, BIAS_M)), float(rng.uniform(-_ROLL_RAD, _ROLL_RAD))
    began_m: Floats = rng.uniform(-_HAND_M, _HAND_M, 3)
    place_m = began_m
    looked_s = 0.0
    for index in range(_MOST_PLACES):
        missing = sorted(truth_m, key=lambda one: -_stddev_of(landmarks[one]))
        missing = [one for one in missing if _stddev_of(landmarks[one]) > wanted_m]
        if not missing:
            return looked_s
        best_m = best_place([landmarks[one] for one in missing], began_m, reach_m)
        place_m = place_m if best_m is None else best_m
        for group in (list(truth_m), missing, missing[:1]):
            pose = aim(place_m, np.array([truth_m[one] for one in group]), roll, world, rng)
            if pose is not None:
                break
        assert pose is not None
        wanted, stayed_s = set(group) & set(missing), _STAY_S
        scene = places.view_from(pose, world.markers, world.sensor, rng)
        for known_s, detection in places.looks(scene, _STAY_S, rng):
            if detection.id in landmarks:
                seen_from = places.pose_of_tf(pose, 0.0, rng)
                landmarks[detection.id].take(
                    places.reading_of(detection, seen_from, since_s=100.0 * index, bias_m=bias_m)
                )
                wanted.discard(detection.id)
            if not wanted:
                stayed_s = known_s
                break
        looked_s += stayed_s
    return math.inf


def _stddev_of(landmark: Landmark) -> float:
    estimate = landmark.estimate()
    return math.inf if estimate is None else estimate.stddev_m
