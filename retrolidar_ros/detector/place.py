# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose of a marker with covariance, from bearing and range."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from retrolidar_ros.core import ffi, lib
from retrolidar_ros.sensor.frame import Floats, ZoneGrid


class Bearing(NamedTuple):
    """A direction as tangents to the optical axis, x/z and y/z."""

    tangent: Floats  # shape (2,)
    variance: Floats  # of each tangent, shape (2,)


def zone_bearing(zone: int, grid: ZoneGrid) -> Bearing:
    """Return the bearing of a marker that may be anywhere in a zone."""
    return Bearing(grid.tangents[zone], np.full(2, grid.pitch**2 / 12))


@dataclass(frozen=True, eq=False)
class Place:
    """A marker's pose in the optical frame of the sensor: x right, y down, z forward."""

    position_m: Floats  # shape (3,)
    orientation: Floats  # quaternion (x, y, z, w): facing the sensor, z pointing away from it
    covariance: Floats  # of x, y, z [m²] and rotations about these axes [rad²], shape (6, 6)
    range_m: float  # radial distance
    range_stddev_m: float

    @property
    def stddev_m(self) -> float:
        """Deviation of the position along the axis in which it is largest."""
        return largest_stddev(self.covariance[:3, :3])


def place(bearing: Bearing, range_m: float, range_stddev_m: float) -> Place:
    """Return the pose of a marker, with the variance of what is not measured; ranges in [m]."""
    variance = bearing.variance.tolist()
    pose = ffi.new('struct rl_pose *')
    lib.rl_pose(bearing.tangent.tolist(), variance, range_m, range_stddev_m**2, pose)
    values = np.frombuffer(ffi.buffer(pose))
    return Place(
        position_m=values[:3],
        orientation=values[3:7],
        covariance=values[7:].reshape(6, 6),
        range_m=range_m,
        range_stddev_m=range_stddev_m,
    )


def largest_stddev(covariance: Floats) -> float:
    """Return the largest deviation along any axis of a covariance; infinite if it is no number."""
    if not np.isfinite(covariance).all():
        return math.inf
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))
