# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Trials of landmarks: an object of four markers, a drone, a robot in a room."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench import hand_trials as hand
from evaluation.bench.places import PlaceError, looks, place_error, reading_of, rotation, view_from
from evaluation.bench.recordings import signal_at
from retrolidar_ros.marker.known_markers import MARKER_SIZE_M
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, Wander
from retrolidar_ros.scene.optics import position_at, zone_shares
from retrolidar_ros.scene.reference import NOISE, RESPONSE, SENSOR
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.localization import robot_pose, room_of
from retrolidar_ros.tasks.reading import Errors, Reading, SensorPose
from retrolidar_ros.tasks.state import Prior, State

_SURVEY_M = 0.002  # deviation of what is known of the places of markers on walls
CALIBRATED_M = 0.0005  # deviation of a sensor's range bias after a calibration
HEADINGS, STAY_S = 24, 1.6  # in how many directions a robot looks, and how long [s]
_BOUND_STEPS, _SAMPLES = 81, 62
FLIGHT_S = 30.0
# Of the drone, with its assumed acceleration [m/s²/√Hz].
_FOLLOWED = Errors(range_bias_m=CALIBRATED_M, pose_m=1e-3, turn_rad=0.0035, acceleration=0.04)
_EXACT = Errors(range_bias_m=hand.BIAS_M, pose_m=1e-4, turn_rad=1e-4)
_SENSOR = replace(SENSOR, noise=NOISE, blur=0.05)
_HERE = SensorPose(np.zeros(3), np.eye(3))
# Directions of an optical frame in one whose z points up.
_UPRIGHT = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


def world_of(places_m: Mapping[int, Floats], wander: Wander | None = None) -> Scene:
    """Return markers at places [m] by ID."""
    how: dict[str, Any] = {'response': RESPONSE, 'wander': wander}
    markers = (Marker(one, tuple(at_m), f'{one}', **how) for one, at_m in places_m.items())
    return Scene(sensor=_SENSOR, markers=tuple(markers))


def tilt_trial(roll_rad: float, rng: np.random.Generator) -> tuple[float, float, float] | None:
    """Let one place see four markers on 20 cm at 1 m, turned by up to some roll [rad].

    Returns the error of the tilt against the line of sight, for each axis, that of the normal in
    the fixed frame, and a lower bound of the latter from zones and their light [°].
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
    for reading in hand.hand_readings(trial, rng)[0]:
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
    return (
        float(np.linalg.norm(off[0] - off[1])) / math.sqrt(2),
        math.degrees(math.acos(min(cosine, 1.0))),
        math.degrees(_direction_bound(np.array(list(places_m.values())))),
    )


def _direction_bound(places_m: Floats) -> float:
    """Return a lower bound of the error of a rigid object's direction [rad].

    If it is turned about the sensor, its ranges stay, and only the light in the zones changes. This
    is the deviation of the directions that one packet's noise cannot tell from the true one.
    """
    grid = SENSOR.grid
    steps = np.linspace(-1, 1, _BOUND_STEPS) * grid.pitch
    shifts = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 1, 2)
    turned = np.repeat(places_m[None], len(shifts), axis=0)
    turned[..., :2] += shifts * places_m[:, 2:]
    light = zone_shares(turned.reshape(-1, 3), MARKER_SIZE_M, grid, _SENSOR.blur)
    seen = zone_shares(places_m, MARKER_SIZE_M, grid, _SENSOR.blur).ravel()
    signal = signal_at(float(np.linalg.norm(places_m.mean(axis=0))))
    noise = 2 * np.sqrt(NOISE.floor + NOISE.slope * signal * seen) / math.sqrt(_SAMPLES) / signal
    misfit = np.square((light.reshape(len(shifts), -1) - seen) / noise).sum(axis=1)
    weight = np.exp(-0.5 * (misfit - misfit.min()))
    weight /= weight.sum()
    spread = shifts[:, 0] - weight @ shifts[:, 0]
    return math.sqrt(float(weight @ np.square(spread).sum(axis=1)))


def drone_trial(sensors: int, rng: np.random.Generator) -> list[PlaceError]:
    """Follow a drone over one to three sensors on a triangle of 0.4 m that look up."""
    identity, height_m = 2127, float(rng.uniform(1.0, 1.5))
    wander = Wander(across_m=0.12, along_m=0.01, period_s=13.0)
    world = world_of({identity: np.array([0, 0, height_m])}, wander)
    rows: list[tuple[float, Reading]] = []
    clock = int(rng.integers(2**32))
    for index in range(sensors):
        angle, radius_m = 2 * math.pi * index / 3, 0.4 / math.sqrt(3)
        pose = SensorPose(radius_m * np.array([math.cos(angle), math.sin(angle), 0]), np.eye(3))
        # All sensors see the same marker, drawn from one generator.
        scene = view_from(pose, world, np.random.default_rng(clock))
        bias_m = float(rng.normal(0, CALIBRATED_M))
        for known_s, detection in looks(scene, FLIGHT_S, rng):
            if detection.id == identity:
                one = reading_of(detection, pose, bias_m=bias_m)
                rows.append((known_s, one._replace(sensor=str(index))))
    landmark, found = Landmark('drone', {identity: np.zeros(3)}, _FOLLOWED), []
    for _, reading in sorted(rows, key=lambda row: row[0]):
        landmark.take(reading)
        estimate = landmark.estimate()
        if estimate is not None:
            place_m = position_at(world.markers[0], np.array([estimate.stamp_s])).reshape(3)
            found.append(place_error(estimate, place_m))
    return found


def room_trial(markers: int, rng: np.random.Generator) -> tuple[float, float] | None:
    """Let a robot in a room of 4 m turn on the spot, and locate it by markers on the walls.

    Returns the errors of place [m] and heading [rad]; None without a pose.
    """
    base = SensorPose(np.append(rng.uniform(-0.5, 0.5, 2), 0.0), rotation(0, 0, rng.uniform(-3, 3)))
    places: dict[int, Floats] = {}
    for index in range(markers):
        angle = 2 * math.pi * (index + rng.uniform(-0.2, 0.2)) / markers
        way = np.array([math.cos(angle), math.sin(angle), 0])
        height_m = rng.uniform(-0.5, 0.5)
        places[1000 + 101 * index] = 2 * way / np.abs(way).max() + [0, 0, height_m]
    known = {
        str(one): Prior(
            State(place + rng.normal(0, _SURVEY_M, 3), np.eye(3), np.zeros(3)),
            np.diag([_SURVEY_M**2] * 3 + [1.0] * 3),
        )
        for one, place in places.items()
    }
    world = world_of(places)
    room = room_of(known, {str(one): {one: np.zeros(3)} for one in places}, _EXACT, flat=True)
    bias_m = float(rng.normal(0, hand.BIAS_M))
    for index in range(HEADINGS):
        heading = rotation(0, 0, 2 * math.pi * index / HEADINGS) @ _UPRIGHT
        pose = SensorPose(base.position_m, base.rotation @ heading)
        for _, detection in looks(view_from(pose, world, rng), STAY_S, rng):
            if room.has(detection.id):
                seen_from = SensorPose(np.zeros(3), heading)
                room.take(reading_of(detection, seen_from, since_s=100.0 * index, bias_m=bias_m))
    estimate = room.estimate()
    found = None if estimate is None else robot_pose(estimate, np.zeros(3), np.eye(3))
    if found is None:
        return None
    turned = found.rotation @ base.rotation.T
    off_m = float(np.linalg.norm((found.position_m - base.position_m)[:2]))
    return off_m, math.atan2(turned[1, 0], turned[0, 0])
