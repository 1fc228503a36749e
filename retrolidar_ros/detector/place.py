# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose of a marker with covariance, from its bearing and its range."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats, ZoneGrid

# Yaw and pitch of a marker are not measured, but beyond 60° it cannot be read (paper Fig. 11b); its
# roll is arbitrary. Variances of the uniform distributions [rad²].
_TILT_VARIANCE = math.radians(60) ** 2 / 3
_ROLL_VARIANCE = math.pi**2 / 3


class Bearing(NamedTuple):
    """A direction as tangents to the optical axis, x/z and y/z."""

    tangent: Floats
    """Shape (2,)."""
    variance: Floats
    """Of each tangent, shape (2,)."""


def zone_bearing(zone: int, grid: ZoneGrid) -> Bearing:
    """Return the bearing of a marker that may be anywhere in a zone."""
    return Bearing(grid.tangents[zone], np.full(2, grid.pitch**2 / 12))


@dataclass(frozen=True, eq=False)
class Place:
    """A marker's pose in the optical frame of the sensor: x right, y down, z forward."""

    position_m: Floats
    """Shape (3,)."""
    orientation: Floats
    """Quaternion (x, y, z, w), shape (4,): facing the sensor, z pointing away from it."""
    covariance: Floats
    """Of x, y, z [m²] and the rotations about the frame's x, y, z axes [rad²], shape (6, 6)."""
    range_m: float
    """Radial distance."""
    range_stddev_m: float


def facing_sensor(direction: Floats) -> Floats:
    """Return the shortest rotation from the optical axis to a unit vector, as (x, y, z, w)."""
    x, y, z = direction
    quaternion = np.array([-y, x, 0.0, 1.0 + z])
    unit: Floats = quaternion / np.linalg.norm(quaternion)
    return unit


def place(bearing: Bearing, range_m: float, range_stddev_m: float) -> Place:
    """Return the pose of a marker, with the variance of what is not measured.

    Parameters
    ----------
    bearing : Bearing
        Direction of the marker.
    range_m, range_stddev_m : float
        Radial distance and its standard deviation [m].
    """
    ray = np.append(bearing.tangent, 1.0)
    secant = float(np.linalg.norm(ray))
    direction = ray / secant
    # Derivative of the unit vector with respect to the tangents, shape (3, 2).
    per_tangent = (np.eye(3)[:, :2] - np.outer(direction, direction[:2])) / secant
    line_of_sight = np.outer(direction, direction)
    turning = _TILT_VARIANCE * (np.eye(3) - line_of_sight) + _ROLL_VARIANCE * line_of_sight
    across = (per_tangent * bearing.variance) @ per_tangent.T
    # The marker is on a sphere, which bends away from the tangent plane by half the square of the
    # angle; this is the mean square of that for a normal distribution.
    bend = (np.trace(across) ** 2 + 2 * np.trace(across @ across)) / 4
    along = range_stddev_m**2 + range_m**2 * bend
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = range_m**2 * across + along * line_of_sight
    covariance[3:, 3:] = turning
    return Place(
        position_m=range_m * direction,
        orientation=facing_sensor(direction),
        covariance=covariance,
        range_m=range_m,
        range_stddev_m=range_stddev_m,
    )
