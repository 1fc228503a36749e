# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Markers anywhere in a fixed frame, and what a sensor at a pose reads of them.

The fixed frame is optical, as that of a scene's own sensor. Every marker faces its origin, and is
on an object; behind all is a wall.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from evaluation.bench.judging import watch
from evaluation.bench.rates import Rate, rate
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.detector.detection import Place
from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.scene.optics import zone_shares
from retrolidar_ros.sensor.frame import Floats, ZoneGrid
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.tasks.landmarks import Estimate
from retrolidar_ros.tasks.reading import Reading, SensorPose, reading

# The hand is near the scene's sensor, and looks towards the objects.
_HAND_M = 0.2  # at most so far from there along each axis
_TURN_RAD = math.radians(20)  # yaw and pitch from the middle of the objects
_ROLL_RAD = math.radians(45)
_MARGIN_ZONES = 0.25  # from the border to the middle of a marker, to see all of it
_CLOCK_ERROR = 0.01  # of the markers, at most
# An object fills every zone that has so much of its marker's light, and is so far behind it.
_MIN_SHARE = 0.05
_OBJECT_M, _OBJECT_SIGNAL = 0.004, 25.0
_WALL_M, _WALL_SIGNAL = 2.6, 4.0
ELLIPSOID = 7.815
"""95 % of a normal distribution in three dimensions are within so many squared deviations."""


def to_sensor(pose: SensorPose, world_m: Floats) -> Floats:
    """Return points of the world, shape (..., 3), in the frame of a sensor at a pose."""
    return (world_m - pose.position_m) @ pose.rotation


def to_world(pose: SensorPose, sensor_m: Floats) -> Floats:
    """Return points of the frame of a sensor at a pose, shape (..., 3), in the world."""
    return sensor_m @ pose.rotation.T + pose.position_m


def rotation(yaw: float, pitch: float, roll: float) -> Floats:
    """Return a rotation about y (down), then x, then z (forward) [rad], shape (3, 3)."""
    turns = ([0.0, yaw, 0.0], [pitch, 0.0, 0.0], [0.0, 0.0, roll])
    about_y, about_x, about_z = (matrix_of_turn(np.array(turn)) for turn in turns)
    return about_y @ about_x @ about_z


def markers_at(scene: Scene) -> Floats:
    """Return the positions of a scene's markers [m], shape (markers, 3)."""
    return np.array([marker.position_m for marker in scene.markers])


def yaw_of(world_m: Floats, pose: SensorPose) -> float:
    """Return a marker's yaw [rad]: its normal points to the world's origin, not to the sensor."""
    normal, sight = -world_m / np.linalg.norm(world_m), pose.position_m - world_m
    return math.atan2(float(np.linalg.norm(np.cross(normal, sight))), float(normal @ sight))


def sees_all(positions_m: Floats, grid: ZoneGrid) -> bool:
    """Return whether all markers are well within the field of view, each in a zone of its own."""
    steps = positions_m[:, :2] / positions_m[:, 2:] / grid.pitch
    half = np.array([grid.columns, grid.rows]) / 2
    if (positions_m[:, 2] <= 0).any() or (np.abs(steps) > half - _MARGIN_ZONES).any():
        return False
    return len(np.unique(np.floor(steps), axis=0)) == len(steps)


def towards(aim_m: Floats, place_m: Floats, turns: Floats) -> SensorPose:
    """Return a pose that looks at a point, then turns by yaw, pitch and roll [rad]."""
    x, y, z = (aim_m - place_m).tolist()
    yaw, pitch = math.atan2(x, z), -math.atan2(y, math.hypot(x, z))
    return SensorPose(place_m, rotation(yaw + turns[0], pitch + turns[1], turns[2]))


def random_pose(world: Scene, rng: np.random.Generator) -> SensorPose:
    """Return a pose of the hand from which all markers of the world are seen."""
    places_m = markers_at(world)
    while True:
        turns = rng.uniform(-1, 1, 3) * [_TURN_RAD, _TURN_RAD, _ROLL_RAD]
        pose = towards(places_m.mean(axis=0), rng.uniform(-_HAND_M, _HAND_M, 3), turns)
        if sees_all(to_sensor(pose, places_m), world.sensor.grid):
            return pose


def view_from(pose: SensorPose, world: Scene, rng: np.random.Generator) -> Scene:
    """Return what the sensor sees of the world's markers, which repeat, at a pose.

    Those beyond the field of view are left out.
    """
    sensor, grid = world.sensor, world.sensor.grid
    half = grid.pitch * np.array([grid.columns, grid.rows]) / 2
    seen: list[Marker] = []
    depths, signals = np.full(grid.zones, _WALL_M), np.full(grid.zones, _WALL_SIGNAL)
    for marker in world.markers:
        world_m = np.array(marker.position_m)
        sensor_m = to_sensor(pose, world_m)
        x, y, z = sensor_m.tolist()
        if z <= 0.1 or (np.abs(sensor_m[:2]) > half * z).any():
            continue
        clock_error = float(rng.uniform(-_CLOCK_ERROR, _CLOCK_ERROR))
        start_s = float(-rng.uniform(0, PACKET_S))
        own = replace(marker, position_m=(x, y, z), yaw_rad=yaw_of(world_m, pose))
        seen.append(replace(own, clock_error=clock_error, start_s=start_s))
        behind = zone_shares(sensor_m[None], marker.size_m, grid, sensor.blur)[0] > _MIN_SHARE
        depths[behind] = np.linalg.norm(sensor_m) * grid.z_per_range[behind] + _OBJECT_M
        signals[behind] = _OBJECT_SIGNAL
    walls = zip(depths.tolist(), signals.tolist(), strict=True)
    surfaces = tuple(Surface(*wall, (zone,)) for zone, wall in enumerate(walls))
    return Scene(sensor=sensor, markers=tuple(seen), surfaces=surfaces)


class PlaceError(NamedTuple):
    """Errors of a place."""

    range_m: float  # measured less true
    position_m: float  # distance between measured and true position
    stddev_m: float  # of the position as estimated, along the worst axis
    squared_distance: float  # of the position, in standard deviations of its covariance


def place_error(place: Place | Estimate, truth_m: Floats) -> PlaceError:
    """Return the errors of a place against the truth at its stamp, shape (3,) [m]."""
    offset, covariance = place.position_m - truth_m, place.covariance[:3, :3]
    return PlaceError(
        range_m=float(np.linalg.norm(place.position_m) - np.linalg.norm(truth_m)),
        position_m=float(np.linalg.norm(offset)),
        stddev_m=math.sqrt(float(np.linalg.eigvalsh(covariance)[-1])),
        squared_distance=float(offset @ np.linalg.solve(covariance, offset)),
    )


def rms(values: ArrayLike) -> float | None:
    """Return the root mean square of values, None without any."""
    return float(np.sqrt(np.mean(np.square(values)))) if np.size(values) else None


def median_mm(errors_m: ArrayLike) -> float | None:
    """Return the median size of errors [m] in millimetres, None without any."""
    return 1e3 * float(np.median(np.abs(errors_m))) if np.size(errors_m) else None


def rms_mm(errors_m: ArrayLike) -> float | None:
    """Return the root mean square of errors [m] in millimetres, None without any."""
    return rms(1e3 * np.asarray(errors_m))


def held(squared_distances: ArrayLike) -> Rate | None:
    """Return in how many places the truth is within the 95 % ellipsoid; None without any."""
    squared = np.asarray(squared_distances)
    return rate(int(np.count_nonzero(squared <= ELLIPSOID)), squared.size) if squared.size else None


def looks(
    scene: Scene, duration_s: float, rng: np.random.Generator
) -> Iterator[tuple[float, Detection]]:
    """Yield what the default reads of a scene, and when it is known [s after the first frame]."""
    recording = Simulation(scene, rng).run(duration_s)
    for step in watch(create_detector('joint', recording.grid), recording):
        for detection in step.detections:
            yield step.known_s, detection


def pose_of_tf(pose: SensorPose, stddev_m: float, rng: np.random.Generator) -> SensorPose:
    """Return a pose as TF has it: off by a deviation [m], and by 1.75 rad/m about each axis."""
    off_m, turn = rng.normal(0, stddev_m, 3), rng.normal(0, 1.75 * stddev_m, 3)
    return SensorPose(pose.position_m + off_m, matrix_of_turn(turn) @ pose.rotation)


def reading_of(
    detection: Detection, pose: SensorPose, *, since_s: float = 0.0, bias_m: float = 0.0
) -> Reading:
    """Return a detection as a reading by one sensor, at its stamp and `since_s` more [s]."""
    place, stamp_s = detection.place, detection.stamp_ns * 1e-9 + since_s
    range_m, covariance = place.range_m + bias_m, place.covariance[:3, :3]
    where = (range_m, place.range_stddev_m, place.position_m, covariance, pose)
    return reading(detection.id, 'sensor', stamp_s, *where)
