# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a marker is: from a zone's direction and its distance to a pose with covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from retrolidar_ros.frame import Floats, ZoneGrid

# Yaw and pitch of a marker cannot be seen, but beyond 60° it cannot be read (paper Fig. 11b);
# its roll can be anything. Variances of the uniform distributions [rad²].
_TILT_VARIANCE = math.radians(60) ** 2 / 3
_ROLL_VARIANCE = math.pi**2 / 3


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


def place_in_zone(zone: int, distance_m: float, stddev_m: float, grid: ZoneGrid) -> Place:
    """Place a marker that one zone saw: it is anywhere in the zone, at the measured range.

    Parameters
    ----------
    zone : int
        Index of the zone.
    distance_m : float
        As the sensor reports it, along the optical axis [m].
    stddev_m : float
        Standard deviation of that distance [m].
    grid : ZoneGrid
        The zones.

    Returns
    -------
    Place
        At the zone's centre, with the variance of a uniform distribution over the zone.
    """
    # Undo the sensor's own projection, whose factor is that of the zone and not of the target.
    range_m = distance_m / grid.z_per_range[zone]
    range_stddev_m = stddev_m / grid.z_per_range[zone]
    direction = grid.directions[zone]
    secant = 1 / direction[2]
    # Derivative of the unit vector with respect to the tangents, shape (3, 2).
    per_tangent = (np.eye(3)[:, :2] - np.outer(direction, direction[:2])) / secant
    across = range_m**2 * grid.pitch**2 / 12 * per_tangent @ per_tangent.T
    along = range_stddev_m**2 * np.outer(direction, direction)
    line_of_sight = np.outer(direction, direction)
    turning = _TILT_VARIANCE * (np.eye(3) - line_of_sight) + _ROLL_VARIANCE * line_of_sight
    covariance = np.zeros((6, 6))
    covariance[:3, :3] = across + along
    covariance[3:, 3:] = turning
    return Place(
        position_m=range_m * direction,
        orientation=facing_sensor(direction),
        covariance=covariance,
        range_m=float(range_m),
        range_stddev_m=float(range_stddev_m),
    )
