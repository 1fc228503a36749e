# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor sees that a robot's hand holds: a shipped scene from other places than its own.

The world is the optical frame of the scene's own sensor. Every marker faces that sensor, and is
on an object of which the scene knows the signal; behind all is the wall of the room.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.scene.optics import zone_shares
from retrolidar_ros.sensor.frame import Floats, ZoneGrid

# The hand is about where the scene has its sensor, and looks about where the objects are.
_HAND_M = 0.2  # at most so far from there along each axis
_TURN_RAD = math.radians(20)  # yaw and pitch from the middle of the objects
_ROLL_RAD = math.radians(45)
# Whole markers must be seen: their middles are so far from the border, in zones.
_MARGIN_ZONES = 0.25
_CLOCK_ERROR = 0.01  # of the markers, at most
# An object is in every zone that has so much of its marker's light, and so far behind it.
_LEAST_SHARE = 0.05
_BEHIND_M = 0.004


class Pose(NamedTuple):
    """Where the sensor is in the world, and how it is turned."""

    position_m: Floats
    """Shape (3,)."""
    rotation: Floats
    """Turns directions of the sensor's frame into those of the world, shape (3, 3)."""

    def to_sensor(self, world_m: Floats) -> Floats:
        """Return points of the world, shape (..., 3), in the sensor's frame."""
        points: Floats = (world_m - self.position_m) @ self.rotation
        return points

    def to_world(self, sensor_m: Floats) -> Floats:
        """Return points of the sensor's frame, shape (..., 3), in the world."""
        points: Floats = sensor_m @ self.rotation.T + self.position_m
        return points


def rotation(yaw: float, pitch: float, roll: float) -> Floats:
    """Return a rotation about y (down), then x, then z (forward) [rad], shape (3, 3)."""
    (sin_y, sin_p, sin_r), (cos_y, cos_p, cos_r) = (f([yaw, pitch, roll]) for f in (np.sin, np.cos))
    about_y = np.array([[cos_y, 0, sin_y], [0, 1, 0], [-sin_y, 0, cos_y]])
    about_x = np.array([[1, 0, 0], [0, cos_p, -sin_p], [0, sin_p, cos_p]])
    about_z = np.array([[cos_r, -sin_r, 0], [sin_r, cos_r, 0], [0, 0, 1]])
    turned: Floats = about_y @ about_x @ about_z
    return turned


def markers_at(scene: Scene) -> Floats:
    """Return the positions of a scene's markers [m], shape (markers, 3)."""
    return np.array([marker.position_m for marker in scene.markers])


def yaw_of(world_m: Floats, pose: Pose) -> float:
    """Return a marker's yaw [rad]: its normal points to the world's origin, not to the sensor."""
    normal = -world_m / np.linalg.norm(world_m)
    sight = pose.position_m - world_m
    across = float(np.linalg.norm(np.cross(normal, sight)))
    return math.atan2(across, float(normal @ sight))


def sees_all(positions_m: Floats, grid: ZoneGrid) -> bool:
    """Return whether all markers are well within the field of view, each in a zone of its own."""
    if (positions_m[:, 2] <= 0).any():
        return False
    steps = positions_m[:, :2] / positions_m[:, 2:] / grid.pitch
    half = np.array([grid.columns, grid.rows]) / 2
    if (np.abs(steps) > half - _MARGIN_ZONES).any():
        return False
    return len(np.unique(np.floor(steps), axis=0)) == len(steps)


def random_pose(world: Scene, rng: np.random.Generator) -> Pose:
    """Return a pose of the hand from which all markers of the world are seen."""
    positions_m = markers_at(world)
    while True:
        position_m = rng.uniform(-_HAND_M, _HAND_M, 3)
        x, y, z = (positions_m.mean(axis=0) - position_m).tolist()
        yaw, pitch = math.atan2(x, z), -math.atan2(y, math.hypot(x, z))
        turns = rng.uniform(-1, 1, 3) * [_TURN_RAD, _TURN_RAD, _ROLL_RAD]
        pose = Pose(position_m, rotation(yaw + turns[0], pitch + turns[1], turns[2]))
        if sees_all(pose.to_sensor(positions_m), world.sensor.grid):
            return pose


def _zones_of(marker: Marker, world: Scene) -> list[int]:
    """Return the zones that see a marker, the one that sees most of it first."""
    position_m = np.array([marker.position_m])
    shares = zone_shares(position_m, marker.size_m, world.sensor.grid, world.sensor.blur)[0]
    return [zone for zone in np.argsort(-shares).tolist() if shares[zone] > _LEAST_SHARE]


def _wall(world: Scene) -> Surface:
    """Return the farthest surface: the wall of the room, a plane across the world's z axis."""
    return max(world.surfaces, key=lambda surface: surface.distance_m)


def _object_behind(marker: Marker, world: Scene) -> Surface:
    """Return the surface of the world that a marker of it is fixed to."""
    zone = _zones_of(marker, world)[0]
    return next(one for one in world.surfaces if one.zones is None or zone in one.zones)


def view_from(pose: Pose, world: Scene, rng: np.random.Generator) -> Scene:
    """Return what a sensor at a pose sees of the world; its markers have always been sending."""
    grid = world.sensor.grid
    packet_s = PACKET_BITS * BIT_PERIOD_S
    markers: list[Marker] = []
    surfaces: list[Surface] = []
    for marker in world.markers:
        world_m = np.array(marker.position_m)
        sensor_m = pose.to_sensor(world_m)
        x, y, z = sensor_m.tolist()
        seen = replace(
            marker,
            position_m=(x, y, z),
            yaw_rad=yaw_of(world_m, pose),
            clock_error=float(rng.uniform(-_CLOCK_ERROR, _CLOCK_ERROR)),
            start_s=float(-rng.uniform(0, packet_s)),
        )
        markers.append(seen)
        signal = _object_behind(marker, world).signal
        range_m = float(np.linalg.norm(sensor_m))
        surfaces += [
            Surface(range_m * float(grid.z_per_range[zone]) + _BEHIND_M, signal, (zone,))
            for zone in _zones_of(seen, world)
        ]
    covered = {zone for surface in surfaces for zone in surface.zones or ()}
    wall = _wall(world)
    towards = np.append(grid.tangents, np.ones((grid.zones, 1)), axis=1) @ pose.rotation.T
    depths_m = (wall.distance_m - pose.position_m[2]) / towards[:, 2]
    surfaces += [
        Surface(float(depths_m[zone]), wall.signal, (zone,))
        for zone in range(grid.zones)
        if zone not in covered
    ]
    return replace(world, markers=tuple(markers), surfaces=tuple(surfaces))
