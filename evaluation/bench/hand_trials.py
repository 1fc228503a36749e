# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of a hand that looks at objects from several places, and of `landmarks` on its readings.

It holds a LiDAR, or a camera that looks at AprilTags in the places of the markers.
"""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from evaluation.bench import places
from evaluation.bench.places import PlaceError
from evaluation.peers.camera import FOCAL_PX, Background, Pose, expose, facing, facing_pose, tilted
from evaluation.peers.visual_markers import AprilTagReader, square_range
from retrolidar_ros.detector import Detection
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.next_view import best_place
from retrolidar_ros.tasks.reading import Errors, Reading, SensorPose

CORNERS = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]) / 2
BIAS_M = 0.002  # deviation of a sensor's range bias
VISIT_S, _MAX_READINGS = 4.3, 3  # of each place, and of one marker there
_HAND_M, _ROLL_RAD = 0.15, 0.6
_AIM_RAD = math.radians(3)
_STAY_S, _MAX_PLACES = 2.2, 16
"""Longest time at a place, and the most places."""
_SIZE_M, _LUX, _TAG = 0.03, 300.0, 7
_RANGES_M, _TRIES = (0.8, 1.2, 1.6, 1.9, 2.2), 16
_PICTURES = 3  # whose mean is a reading; the error that is left comes from pixels
_TILT_RAD, _TAG_AIM_RAD = 0.2, math.radians(5)
_EXACT = 1e-5

Visit = tuple[SensorPose, list[Detection]]  # a place of the hand, and what it read there


def aim(
    place_m: Floats, targets_m: Floats, roll: float, world: Scene, rng: np.random.Generator
) -> SensorPose | None:
    """Return a pose that sees all targets, shape (n, 3) [m], near its middle; None: there is none.

    It is at a place, shape (3,) [m], with a roll to within 3° [rad].
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
        corners = centre_m + side_m * CORNERS @ turned.T
        found = [aim(place_m, places.markers_at(world), roll, world, rng) for place_m in corners]
        poses = [pose for pose in found if pose is not None]
        if len(poses) == len(CORNERS):
            return poses


def visit(pose: SensorPose, world: Scene, rng: np.random.Generator) -> Visit:
    """Let the hand stay at a pose."""
    looks = places.looks(places.view_from(pose, world, rng), VISIT_S, rng)
    return pose, [one for _, one in looks]


def visits(world: Scene, side_m: float, rng: np.random.Generator) -> list[Visit]:
    """Let the hand stay at each corner of a square."""
    return [visit(pose, world, rng) for pose in hand_poses(world, side_m, rng)]


def hand_readings(
    trial: Sequence[Visit], rng: np.random.Generator, pose_m: float = 0.0
) -> list[list[Reading]]:
    """Return readings by place of the hand, at most `_MAX_READINGS` of one marker at each.

    The range has a random bias; TF is off by a deviation of `pose_m` [m].
    """
    bias_m = float(rng.normal(0, BIAS_M))
    found: list[list[Reading]] = []
    for index, (at, detections) in enumerate(trial):
        pose, since_s = places.pose_of_tf(at, pose_m, rng), 100.0 * index
        count: Counter[int] = Counter()
        found.append([])
        for one in detections:
            count[one.id] += 1
            if count[one.id] <= _MAX_READINGS:
                found[-1].append(places.reading_of(one, pose, since_s=since_s, bias_m=bias_m))
    return found


def errors_for(pose_m: float) -> Errors:
    """Return the errors that landmarks assume in a trial."""
    return Errors(range_bias_m=BIAS_M, pose_m=max(pose_m, 1e-4), turn_rad=max(1.75 * pose_m, 1e-4))


def _landmarks(world: Scene, errors: Errors) -> dict[int, Landmark]:
    return {one.id: Landmark(one.name, {one.id: np.zeros(3)}, errors) for one in world.markers}


def errors_after(
    readings: Iterable[Reading], world: Scene, errors: Errors
) -> dict[Marker, PlaceError]:
    """Return the errors of landmarks after some readings, by marker; of those that are known."""
    landmarks, found = _landmarks(world, errors), {}
    for reading in readings:
        if reading.marker in landmarks:
            landmarks[reading.marker].take(reading)
    for marker in world.markers:
        estimate = landmarks[marker.id].estimate()
        if estimate is not None:
            found[marker] = places.place_error(estimate, np.array(marker.position_m))
    return found


def ready_s(world: Scene, wanted_m: float, reach_m: float, rng: np.random.Generator) -> float:
    """Return how long a hand looks until all objects are known [s], infinite if it gives up.

    It goes to the best next place, and leaves when every unknown object in view has been read
    there, or after a timeout. If it cannot see all of those at once, it looks at the one with the
    largest deviation. An object is known when its deviation along the worst axis is `wanted_m` [m];
    the hand can go `reach_m` from its first place [m].
    """
    truth_m = dict(zip((one.id for one in world.markers), places.markers_at(world), strict=True))
    landmarks = _landmarks(world, errors_for(0.0))
    bias_m, roll = float(rng.normal(0, BIAS_M)), float(rng.uniform(-_ROLL_RAD, _ROLL_RAD))
    began_m: Floats = rng.uniform(-_HAND_M, _HAND_M, 3)
    place_m, looked_s = began_m, 0.0
    for index in range(_MAX_PLACES):
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
        scene, since_s = places.view_from(pose, world, rng), 100.0 * index
        for known_s, one in places.looks(scene, _STAY_S, rng):
            if one.id in landmarks:
                seen_from = places.pose_of_tf(pose, 0.0, rng)
                reading = places.reading_of(one, seen_from, since_s=since_s, bias_m=bias_m)
                landmarks[one.id].take(reading)
                wanted.discard(one.id)
            if not wanted:
                stayed_s = known_s
                break
        looked_s += stayed_s
    return math.inf


def _stddev_of(landmark: Landmark) -> float:
    estimate = landmark.estimate()
    return math.inf if estimate is None else estimate.stddev_m


class TagCamera:
    """A camera that reads tags, and knows its own errors."""

    def __init__(self, rng: np.random.Generator) -> None:
        """Take pictures of tags at known places to learn the deviations."""
        self._reader = AprilTagReader()
        self._background = Background(rng)
        turns, self._stddev_m = [], []
        for range_m in _RANGES_M:
            off_m = []
            for _ in range(_TRIES):
                pose = facing_pose(range_m, 3 * FOCAL_PX * _SIZE_M / range_m, _ROLL_RAD, rng)
                seen_m = self._see(tilted(pose, *rng.uniform(-_TILT_RAD, _TILT_RAD, 2)), rng)
                if seen_m is not None:
                    seen_range_m = float(np.linalg.norm(seen_m))
                    turns += (seen_m / seen_range_m - pose.position_m / range_m)[:2].tolist()
                    off_m.append(seen_range_m - range_m)
            self._stddev_m.append(places.rms(off_m) or math.nan)
        self.turn_rad = places.rms(turns) or math.nan
        """Deviation of a direction, along each axis."""

    def errors(self, pose_m: float) -> Errors:
        """Return the errors that landmarks have to assume."""
        own = {'range_bias_m': 1e-4, 'range_m': 0.0, 'box_rad': 0.0, 'edge_rad': self.turn_rad}
        exact = {} if pose_m else {'turn_rad': _EXACT}
        return replace(errors_for(pose_m), **own, **exact)

    def readings(
        self, trial: Sequence[Visit], world: Scene, pose_m: float, rng: np.random.Generator
    ) -> list[Reading]:
        """Return what it reads from the places of a hand.

        It turns to each tag: a hand from which the LiDAR sees all its markers would have some tags
        out of the picture. Tags face the world's origin.
        """
        rows = []
        for index, (hand, _) in enumerate(trial):
            for marker in world.markers:
                at_m = np.array(marker.position_m)
                turns = np.append(rng.uniform(-_TAG_AIM_RAD, _TAG_AIM_RAD, 2), 0.0)
                camera = places.towards(at_m, hand.position_m, turns)
                turned = camera.rotation.T @ facing(at_m).rotation
                seen_m = self._see(Pose(places.to_sensor(camera, at_m), turned), rng)
                if seen_m is not None:
                    range_m = float(np.linalg.norm(seen_m))
                    pose = places.pose_of_tf(camera, pose_m, rng)
                    stddev_m = float(np.interp(range_m, _RANGES_M, self._stddev_m))
                    where = (range_m, stddev_m, seen_m / range_m, np.full(2, _EXACT), pose)
                    rows.append(Reading(marker.id, 'camera', 100.0 * index, *where))
        return rows

    def _see(self, pose: Pose, rng: np.random.Generator) -> Floats | None:
        """Return where a tag is in the camera's frame [m], by the mean of pictures that show it."""
        plate = self._reader.plate(_TAG, _SIZE_M)
        light, window = self._background.with_plate(plate.cells, plate.side_m, pose)
        found = []
        for _ in range(_PICTURES):
            for tag in self._reader.detector.detect(expose(light, _LUX, rng)):
                if tag.tag_id == _TAG:
                    edge_m = _SIZE_M * self._reader.border
                    ray = np.append((np.array(tag.center) - window.centre_px) / FOCAL_PX, 1.0)
                    range_m = square_range(tag.corners, window.centre_px, edge_m)
                    found.append(range_m * ray / np.linalg.norm(ray))
        return np.mean(found, axis=0) if found else None
