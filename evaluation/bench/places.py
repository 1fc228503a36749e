# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Markers anywhere in a fixed frame, what a sensor at a pose reads of them, and as what."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from evaluation.bench.hand import Pose
from evaluation.bench.live import read_live
from retrolidar_ros.detector import Detection, create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface, Wander
from retrolidar_ros.scene.optics import zone_shares
from retrolidar_ros.scene.reference import NOISE, RESPONSE, SENSOR
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.tasks.reading import Reading, SensorPose, reading

BLUR = 0.05
_MOUNT_M, _MOUNT_SIGNAL = 0.004, 20.0
_WALL_M, _WALL_SIGNAL = 2.6, 4.0
_LEAST_SHARE = 0.05
_CLOCK_ERROR = 0.01


class Look(NamedTuple):
    """One detection, from when it was known on."""

    known_s: float
    detection: Detection


def looks(scene: Scene, duration_s: float, rng: np.random.Generator) -> Iterator[Look]:
    """Yield what a detector reads of a scene, in order, by the time from the first frame."""
    recording = Simulation(scene, rng).run(duration_s)
    origin_ns = int(recording.stamp_ns[0])
    for known_ns, detection in read_live(create_detector('joint', recording.grid), recording):
        yield Look((known_ns - origin_ns) * 1e-9, detection)


def scene_of(
    pose: Pose,
    places_m: Mapping[int, Floats],
    rng: np.random.Generator,
    wander: Wander | None = None,
) -> Scene:
    """Return what a sensor sees of markers that face it, each on an object of its own.

    Parameters
    ----------
    pose : Pose
        Of the sensor.
    places_m : mapping of int to array, shape (3,)
        Where the markers are, by ID [m]; those beyond the field of view are left out.
    rng : numpy.random.Generator
        Of the markers' clocks.
    wander : Wander or None
        How they move.
    """
    sensor = replace(SENSOR, noise=NOISE, blur=BLUR)
    grid = sensor.grid
    half = grid.pitch * grid.columns / 2
    markers: list[Marker] = []
    depths = np.full(grid.zones, _WALL_M)
    signals = np.full(grid.zones, _WALL_SIGNAL)
    for identity, place_m in places_m.items():
        x, y, z = pose.to_sensor(place_m).tolist()
        if z <= 0.1 or max(abs(x), abs(y)) > half * z:
            continue
        marker = Marker(
            id=identity,
            position_m=(x, y, z),
            name=f'marker_{identity}',
            clock_error=float(rng.uniform(-_CLOCK_ERROR, _CLOCK_ERROR)),
            start_s=float(-rng.uniform(0, PACKET_BITS * BIT_PERIOD_S)),
            response=RESPONSE,
            wander=wander,
        )
        markers.append(marker)
        shares = zone_shares(np.array([[x, y, z]]), marker.size_m, grid, sensor.blur)[0]
        for zone in np.flatnonzero(shares > _LEAST_SHARE):
            depths[zone], signals[zone] = z + _MOUNT_M, _MOUNT_SIGNAL
    surfaces = tuple(
        Surface(float(depths[zone]), float(signals[zone]), (zone,)) for zone in range(grid.zones)
    )
    return Scene(sensor=sensor, markers=tuple(markers), surfaces=surfaces)


def pose_of_tf(pose: Pose, stddev_m: float, rng: np.random.Generator) -> SensorPose:
    """Return where TF has a sensor: off by a deviation [m], and by 1.75 rad/m about each axis."""
    off_m, turn = rng.normal(0, stddev_m, 3), rng.normal(0, 1.75 * stddev_m, 3)
    return SensorPose(pose.position_m + off_m, matrix_of_turn(turn) @ pose.rotation)


def reading_of(
    detection: Detection, pose: SensorPose, *, since_s: float = 0.0, bias_m: float = 0.0
) -> Reading:
    """Return a detection as a reading by one sensor, at its stamp and `since_s` more [s]."""
    place = detection.place
    return reading(
        detection.id,
        'sensor',
        detection.stamp_ns * 1e-9 + since_s,
        place.range_m + bias_m,
        place.range_stddev_m,
        place.position_m,
        place.covariance[:3, :3],
        pose,
    )
