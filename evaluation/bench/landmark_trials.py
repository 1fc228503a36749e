# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of landmarks: an object of four markers, a drone above sensors, and a robot in a room."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench import hand_trials as hand
from evaluation.bench import places
from evaluation.bench.places import PlaceError, place_error, rotation
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, Wander
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.scene.reference import RESPONSE, SENSOR
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.localization import robot_pose, room_of
from retrolidar_ros.tasks.reading import Errors, KnownPose, Reading, SensorPose

_SURVEY_M = 0.002  # deviation of what is known of the places of markers on walls
_CALIBRATED_M = 0.0005  # deviation of a sensor's range bias after a calibration
_HEADINGS, _STAY_S = 24, 1.6  # in how many directions a robot looks, and how long [s]
_FLIGHT_S = 30.0
# Of the drone, with its assumed acceleration [m/s²/√Hz].
_FOLLOWED = Errors(range_bias_m=_CALIBRATED_M, pose_m=1e-3, turn_rad=0.0035, acceleration=0.04)
_EXACT = Errors(range_bias_m=hand.BIAS_M, pose_m=1e-4, turn_rad=1e-4)
_SENSOR = replace(SENSOR, blur=0.05)
_HERE = SensorPose(np.zeros(3), np.eye(3))
# Directions of an optical frame in one whose z points up.
_UPRIGHT = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def _world_of(places_m: Mapping[int, Floats], wander: Wander | None = None) -> Scene:
    """Return markers at places [m] by ID."""
    how: dict[str, Any] = {'response': RESPONSE, 'wander': wander}
    markers = (Marker(one, tuple(at_m), f'{one}', **how) for one, at_m in places_m.items())
    return Scene(sensor=_SENSOR, markers=tuple(markers))


def tilt_trial(roll_rad: float, rng: np.random.Generator) -> tuple[float, float] | None:
    """Let one place see four markers on 20 cm at 1 m, turned by up to some roll [rad].

    Returns errors of the tilt against the line of sight, and of the normal in the fixed frame [°].
    """
    on_object = {1000 + 101 * n: corner for n, corner in enumerate(0.2 * hand.CORNERS)}
    roll = matrix_of_turn(np.array([0, 0, rng.uniform(-roll_rad, roll_rad)]))
    way = rng.uniform(0, 2 * math.pi)
    tilt = rng.uniform(0, math.radians(30)) * np.array([math.cos(way), math.sin(way), 0])
    turned = matrix_of_turn(tilt) @ roll
    centre_m = np.append(rng.uniform(-0.1, 0.1, 2), 1.0)
    places_m = {one: centre_m + turned @ at for one, at in on_object.items()}
    trial = [hand.visit(_HERE, _world_of(places_m), rng)]
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
    sight_deg = float(np.linalg.norm(off[0] - off[1])) / math.sqrt(2)
    return sight_deg, math.degrees(math.acos(min(cosine, 1.0)))


def drone_trial(rng: np.random.Generator) -> list[PlaceError]:
    """Follow a drone over three sensors on a triangle of 0.4 m that look up."""
    identity, height_m = 2127, float(rng.uniform(1.0, 1.5))
    wander = Wander(across_m=0.12, along_m=0.01, period_s=13.0)
    world = _world_of({identity: np.array([0, 0, height_m])}, wander)
    rows: list[tuple[float, Reading]] = []
    clock = int(rng.integers(2**32))
    for index in range(3):
        angle, radius_m = 2 * math.pi * index / 3, 0.4 / math.sqrt(3)
        pose = SensorPose(radius_m * np.array([math.cos(angle), math.sin(angle), 0]), np.eye(3))
        # All sensors see the same marker, drawn from one generator.
        scene = places.view_from(pose, world, np.random.default_rng(clock))
        bias_m = float(rng.normal(0, _CALIBRATED_M))
        for known_s, detection in places.looks(scene, _FLIGHT_S, rng):
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
    unsure = np.eye(3), np.diag([_SURVEY_M**2] * 3 + [1.0] * 3)
    known = {
        str(one): KnownPose(place + rng.normal(0, _SURVEY_M, 3), *unsure)
        for one, place in on_walls.items()
    }
    world = _world_of(on_walls)
    room = room_of(known, {str(one): {one: np.zeros(3)} for one in on_walls}, _EXACT, flat=True)
    bias_m = float(rng.normal(0, hand.BIAS_M))
    errors_m: list[Floats] = []
    for index in range(_HEADINGS):
        heading = rotation(0, 0, 2 * math.pi * index / _HEADINGS) @ _UPRIGHT
        pose = SensorPose(base.position_m, base.rotation @ heading)
        seen_from, since_s = SensorPose(np.zeros(3), heading), 100.0 * index
        for _, detection in places.looks(places.view_from(pose, world, rng), _STAY_S, rng):
            if room.has(detection.id):
                room.take(places.reading_of(detection, seen_from, since_s=since_s, bias_m=bias_m))
                estimate = room.estimate()
                found = None if estimate is None else robot_pose(estimate, np.zeros(3), np.eye(3))
                if found is not None:
                    errors_m.append(found.position_m - base.position_m)
    return errors_m
