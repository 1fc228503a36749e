# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of landmarks: a hand at several places, an object, a drone, a robot in a room."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from evaluation.bench.places import (
    Look,
    Pose,
    looks,
    markers_at,
    pose_of_tf,
    reading_of,
    rotation,
    sees_all,
    towards,
    view_from,
)
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, Wander
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.scene.reference import NOISE, RESPONSE, SENSOR
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.tasks.landmarks import Estimate, Landmark
from retrolidar_ros.tasks.least_squares import Prior, State
from retrolidar_ros.tasks.localization import RobotPose, robot_pose, room_of
from retrolidar_ros.tasks.reading import Errors, Reading, SensorPose

CORNERS = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]) / 2
BIAS_M, CALIBRATED_M = 0.002, 0.0005
"""Deviation of a sensor's range bias, and after a calibration against a known range."""
HEADINGS, STAY_S = 24, 1.6  # in how many directions a robot looks, and how long [s]
_HAND_M = 0.15
_AIM_RAD = math.radians(3)
_EXACT = Errors(range_bias_m=BIAS_M, pose_m=1e-4, turn_rad=1e-4)
_SENSOR = replace(SENSOR, noise=NOISE, blur=0.05)
_HERE = Pose(np.zeros(3), np.eye(3))
# Directions of an optical frame in one whose z points up.
_UPRIGHT = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


class Error(NamedTuple):
    """By how much an estimate is wrong."""

    error_m: float
    stddev_m: float  # as estimated, along the worst axis
    squared_distance: float  # in standard deviations


def error_of(estimate: Estimate, truth_m: Floats) -> Error:
    """Return by how much a position is wrong."""
    off = estimate.position_m - truth_m
    squared = float(off @ np.linalg.solve(estimate.covariance[:3, :3], off))
    return Error(float(np.linalg.norm(off)), estimate.stddev_m, squared)


def markers_of(places_m: Mapping[int, Floats], wander: Wander | None = None) -> list[Marker]:
    """Return markers at places [m] by ID."""
    return [
        Marker(one, tuple(place_m), f'{one}', response=RESPONSE, wander=wander)
        for one, place_m in places_m.items()
    ]


def hand_poses(world: Scene, side_m: float, rng: np.random.Generator) -> list[Pose]:
    """Return the hand at the corners of a square, all markers in view of each."""
    places_m = markers_at(world)
    while True:
        centre_m, roll = rng.uniform(-_HAND_M, _HAND_M, 3), rng.uniform(-0.6, 0.6)
        turned = rotation(0, 0, rng.uniform(0, 2 * math.pi))
        poses = []
        for corner in CORNERS:
            corner_m = centre_m + side_m * turned @ np.append(corner, 0)
            # An arm aims at the middle of the objects as well as it can see them all.
            for _ in range(100):
                turns = np.array([0, 0, roll]) + rng.uniform(-_AIM_RAD, _AIM_RAD, 3)
                pose = towards(places_m.mean(axis=0), corner_m, turns)
                if sees_all(pose.to_sensor(places_m), world.sensor.grid):
                    poses.append(pose)
                    break
        if len(poses) == len(CORNERS):
            return poses


class Visit(NamedTuple):
    """One place of the hand, and what it read there, in order."""

    pose: Pose
    looks: list[Look]


def visits(world: Scene, side_m: float, stay_s: float, rng: np.random.Generator) -> list[Visit]:
    """Let the hand stay at each corner of a square."""
    return [
        Visit(pose, list(looks(view_from(pose, world.markers, world.sensor, rng), stay_s, rng)))
        for pose in hand_poses(world, side_m, rng)
    ]


def hand_readings(
    trial: Sequence[Visit], most: int, rng: np.random.Generator, pose_m: float = 0.0
) -> list[list[tuple[float, Reading]]]:
    """Return readings by place of the hand, each with when it is known [s] there.

    No more of one marker count than `most`, and the poses of TF have a deviation of `pose_m`.
    """
    bias_m = float(rng.normal(0, BIAS_M))
    places = []
    for index, visit in enumerate(trial):
        pose = pose_of_tf(visit.pose, pose_m, rng)
        count: Counter[int] = Counter()
        rows = []
        for known_s, one in visit.looks:
            count[one.id] += 1
            if count[one.id] <= most:
                own = reading_of(one, pose, since_s=100.0 * index, bias_m=bias_m)
                rows.append((known_s, own))
        places.append(rows)
    return places


def errors_for(pose_m: float) -> Errors:
    """Return the errors that landmarks assume in a trial."""
    return Errors(range_bias_m=BIAS_M, pose_m=max(pose_m, 1e-4), turn_rad=max(1.75 * pose_m, 1e-4))


def placed_from(
    places: Sequence[Sequence[tuple[float, Reading]]], ids: Sequence[int], pose_m: float = 0.0
) -> dict[int, Landmark]:
    """Return the landmarks that readings of some places make, by marker."""
    found = {one: Landmark(str(one), {one: np.zeros(3)}, errors_for(pose_m)) for one in ids}
    for rows in places:
        for _, reading in rows:
            if reading.marker in found:
                found[reading.marker].take(reading)
    return found


def tilt_trial(roll_rad: float, rng: np.random.Generator) -> tuple[float, float] | None:
    """Let one place see four markers on 20 cm at 1 m, turned by up to some roll [rad].

    Returns the error of the tilt against the line of sight, and in the fixed frame [°].
    """
    on_object = {1000 + 101 * n: 0.2 * np.append(corner, 0) for n, corner in enumerate(CORNERS)}
    roll = matrix_of_turn(np.array([0, 0, rng.uniform(-roll_rad, roll_rad)]))
    way = rng.uniform(0, 2 * math.pi)
    tilt = rng.uniform(0, math.radians(30)) * np.array([math.cos(way), math.sin(way), 0])
    turned = matrix_of_turn(tilt) @ roll
    centre_m = np.append(rng.uniform(-0.1, 0.1, 2), 1.0)
    markers = markers_of({one: centre_m + turned @ at for one, at in on_object.items()})
    trial = [Visit(_HERE, list(looks(view_from(_HERE, markers, _SENSOR, rng), 4.3, rng)))]
    landmark = Landmark('object', on_object, _EXACT)
    for _, reading in hand_readings(trial, 3, rng)[0]:
        if landmark.has(reading.marker):
            landmark.take(reading)
    estimate = landmark.estimate()
    if estimate is None:
        return None
    off = [
        np.degrees(np.arcsin(turn[:, :2].T @ (at / np.linalg.norm(at))))
        for turn, at in ((estimate.rotation, estimate.position_m), (turned, centre_m))
    ]
    cosine = float(estimate.rotation[:, 2] @ turned[:, 2])
    sight_deg = float(np.linalg.norm(off[0] - off[1])) / math.sqrt(2)
    return sight_deg, math.degrees(math.acos(min(cosine, 1.0)))


class Track(NamedTuple):
    """A drone as sensors on the ground have followed it."""

    errors: list[Error]
    updates_per_s: float


def drone_trial(
    sensors: int, duration_s: float, acceleration: float, rng: np.random.Generator
) -> Track:
    """Follow a drone over one to three sensors on a triangle of 0.4 m that look up.

    It is thought to accelerate by `acceleration` [m/s²/√Hz].
    """
    identity, height_m = 2127, float(rng.uniform(1.0, 1.5))
    wander = Wander(across_m=0.12, along_m=0.01, period_s=13.0)
    (drone,) = markers_of({identity: np.array([0, 0, height_m])}, wander)
    rows: list[tuple[float, Reading]] = []
    clock = int(rng.integers(2**32))
    for index in range(sensors):
        angle, radius_m = 2 * math.pi * index / 3, 0.4 / math.sqrt(3)
        pose = Pose(radius_m * np.array([math.cos(angle), math.sin(angle), 0]), np.eye(3))
        # It is one marker, whichever sensor sees it: all have it from one generator.
        scene = view_from(pose, [drone], _SENSOR, np.random.default_rng(clock))
        bias_m = float(rng.normal(0, CALIBRATED_M))
        for known_s, detection in looks(scene, duration_s, rng):
            if detection.id == identity:
                one = reading_of(detection, SensorPose(*pose), bias_m=bias_m)
                rows.append((known_s, one._replace(sensor=str(index))))
    errors = Errors(
        range_bias_m=CALIBRATED_M, pose_m=1e-3, turn_rad=0.0035, acceleration=acceleration
    )
    landmark, found = Landmark('drone', {identity: np.zeros(3)}, errors), []
    for _, reading in sorted(rows, key=lambda row: row[0]):
        landmark.take(reading)
        estimate = landmark.estimate()
        if estimate is not None:
            place_m = position_at(drone, np.array([estimate.stamp_s])).reshape(3)
            found.append(error_of(estimate, place_m))
    return Track(found, len(found) / duration_s)


def room_trial(
    markers: int, rng: np.random.Generator, survey_m: float = 0.002
) -> tuple[RobotPose, Floats, Floats] | None:
    """Let a robot in a room of 4 m turn on the spot, and locate it by markers on the walls.

    Their places are known to a deviation of `survey_m`. Returns the estimated pose, and the true
    position, shape (3,), and rotation, shape (3, 3).
    """
    base = Pose(np.append(rng.uniform(-0.5, 0.5, 2), 0.0), rotation(0, 0, rng.uniform(-3, 3)))
    places: dict[int, Floats] = {}
    for index in range(markers):
        angle = 2 * math.pi * (index + rng.uniform(-0.2, 0.2)) / markers
        way = np.array([math.cos(angle), math.sin(angle), 0])
        height_m = rng.uniform(-0.5, 0.5)
        places[1000 + 101 * index] = 2 * way / np.abs(way).max() + [0, 0, height_m]
    known = {
        str(one): Prior(
            State(place + rng.normal(0, survey_m, 3), np.eye(3), np.zeros(3)),
            np.diag([survey_m**2] * 3 + [1.0] * 3),
        )
        for one, place in places.items()
    }
    room = room_of(known, {str(one): {one: np.zeros(3)} for one in places}, _EXACT, flat=True)
    bias_m = float(rng.normal(0, BIAS_M))
    for index in range(HEADINGS):
        heading = rotation(0, 0, 2 * math.pi * index / HEADINGS) @ _UPRIGHT
        pose = Pose(base.position_m, base.rotation @ heading)
        scene = view_from(pose, markers_of(places), _SENSOR, rng)
        for _, detection in looks(scene, STAY_S, rng):
            if room.has(detection.id):
                seen_from = SensorPose(np.zeros(3), heading)
                own = reading_of(detection, seen_from, since_s=100.0 * index, bias_m=bias_m)
                room.take(own)
    estimate = room.estimate()
    if estimate is None:
        return None
    return robot_pose(estimate, np.zeros(3), np.eye(3)), base.position_m, base.rotation
