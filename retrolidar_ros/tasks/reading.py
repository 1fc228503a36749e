# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A reading of a marker with the place of the sensor that took it, and how errors are alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats, ZoneGrid


class SensorPose(NamedTuple):
    """Where a sensor was in the fixed frame."""

    position_m: Floats
    """Shape (3,)."""
    rotation: Floats
    """Turns directions of the sensor's optical frame into those of the fixed one, shape (3, 3)."""


class Reading(NamedTuple):
    """One reading of one marker by one sensor."""

    marker: int
    sensor: str
    """Whatever tells sensors apart, such as their frames."""
    stamp_s: float
    range_m: float
    range_stddev_m: float
    direction: Floats
    """Unit vector in the sensor's optical frame, shape (3,)."""
    spread_rad: Floats
    """Deviations of the direction along the rows of `axes_of`, shape (2,)."""
    pose: SensorPose

    def place_m(self) -> Floats:
        """Return where the marker is in the fixed frame by this alone, shape (3,) [m]."""
        place: Floats = self.pose.position_m + self.range_m * (self.pose.rotation @ self.direction)
        return place


def axes_of(direction: Floats) -> Floats:
    """Return two unit vectors across a direction, the first as near to x as can be: (2, 3)."""
    across = np.array([1.0, 0.0, 0.0]) - direction[0] * direction
    across /= np.linalg.norm(across)
    return np.stack([across, np.cross(direction, across)])


def reading(
    marker: int,
    sensor: str,
    stamp_s: float,
    range_m: float,
    range_stddev_m: float,
    position_m: Floats,
    covariance: Floats,
    pose: SensorPose,
) -> Reading:
    """Return a detection as a reading.

    Parameters
    ----------
    marker, sensor, stamp_s, range_m, range_stddev_m, pose
        As in `Reading`.
    position_m : array, shape (3,)
        Of the marker in the sensor's frame [m]; its direction counts.
    covariance : array, shape (3, 3)
        Of that [m²]; what is across the direction counts, the box of a zone.

    Raises
    ------
    ValueError
        For a value that is not a number, or a range or a deviation that is not above 0.
    """
    values = np.concatenate([position_m, covariance.ravel(), [stamp_s, range_m, range_stddev_m]])
    length_m = float(np.linalg.norm(position_m))
    if not np.isfinite(values).all() or min(range_m, range_stddev_m, length_m) <= 0:
        raise ValueError(f'marker {marker}: a range of {range_m} ± {range_stddev_m} m cannot be')
    direction = position_m / length_m
    axes = axes_of(direction)
    variance = np.einsum('ki,ij,kj->k', axes, covariance, axes) / length_m**2
    spread = np.sqrt(np.maximum(variance, 1e-8))
    return Reading(marker, sensor, stamp_s, range_m, range_stddev_m, direction, spread, pose)


@dataclass(frozen=True)
class Errors:
    """Deviations of errors that readings share; what each has for itself it tells."""

    range_bias_m: float = 0.002
    """Of a sensor's range, the same in all its readings; a calibration narrows it."""
    range_m: float = 0.0005
    """Of a range besides what it tells."""
    bearing_rad: float = 0.0175
    """Of a direction besides what it tells: of lens and mounting."""
    pose_m: float = 0.002
    """Of the sensor's position, along each axis."""
    turn_rad: float = 0.0035
    """Of the sensor's orientation, about each axis."""
    acceleration: float = 0.0
    """Density of the noise that a moving marker's acceleration is [m/s²/√Hz]; 0: it stands."""
    speed: float = 0.5
    """Of a moving marker, along each axis [m/s]."""


# What stands behind a marker makes its range wrong in the same way while it is at the same place of
# a zone. Deviations above the usual one are of that kind, and this share of each variance.
_SHARED = 0.25
# Errors of poses are the same so far around [m], those of a bearing in a zone's width.
_POSE_ALIKE_M = 0.05

_ZONE = ZoneGrid().pitch


class Readings:
    """Arrays of the readings that one estimate is made of."""

    def __init__(self, readings: Sequence[Reading]) -> None:
        self.marker = [one.marker for one in readings]
        self.range_m = np.array([one.range_m for one in readings])
        self.range_stddev_m = np.array([one.range_stddev_m for one in readings])
        self.spread_rad = np.array([one.spread_rad for one in readings])
        self.stamp_s = np.array([one.stamp_s for one in readings])
        self.sensor_m = np.array([one.pose.position_m for one in readings])
        self.rotation = np.array([one.pose.rotation for one in readings])
        self.axes = np.array([one.pose.rotation @ axes_of(one.direction).T for one in readings])
        self.axes = self.axes.swapaxes(1, 2)
        sensor = np.array([one.sensor for one in readings])
        marker = np.array(self.marker)
        self._one_sensor = sensor[:, None] == sensor
        self._one_view = self._one_sensor & (marker[:, None] == marker)
        usual = np.array([np.median(self.range_stddev_m[marker == one]) for one in marker])
        variance = self.range_stddev_m**2
        self._shared_m = np.sqrt(np.maximum(variance - usual**2, _SHARED * variance))
        apart = np.linalg.norm(self.sensor_m[:, None] - self.sensor_m, axis=-1)
        self._one_pose = self._one_sensor * np.exp(-0.5 * (apart / _POSE_ALIKE_M) ** 2)

    def covariance(self, sight_m: Floats, before_s: Floats, errors: Errors) -> Floats:
        """Return the covariance of the errors of range [m²] and of direction [rad²].

        Parameters
        ----------
        sight_m : array, shape (n, 3)
            From the sensors to where the markers are now thought to be, in the fixed frame.
        before_s : array, shape (n,)
            How long before the time of the estimate each was taken.
        errors : Errors
            What they share.

        Returns
        -------
        covariance : array, shape (3, n, n)
            Of ranges, of directions along their first and their second axis.
        """
        range_m = np.linalg.norm(sight_m, axis=1)
        unit = sight_m / range_m[:, None]
        frames = np.concatenate([unit[:, None], self.axes], axis=1)
        alike = np.einsum('ick,jck->cij', frames, frames)
        seen = np.einsum('nij,ni->nj', self.rotation, sight_m)
        tangent = seen[:, :2] / np.maximum(seen[:, 2:], 1e-3)
        step = np.abs(tangent[:, None] - tangent) / _ZONE
        in_zone = self._one_view[..., None] * np.maximum(1 - step, 0.0)
        pose = self._one_pose * alike
        shared = errors.pose_m**2 * pose
        if errors.acceleration:
            # A Wiener process of the velocity, told back from the time of the estimate.
            least, most = np.minimum.outer(before_s, before_s), np.maximum.outer(before_s, before_s)
            shared += errors.acceleration**2 * (least**2 * (3 * most - least) / 6) * alike
        result: Floats = shared
        result[1:] /= np.outer(range_m, range_m)
        result[0] += errors.range_bias_m**2 * self._one_sensor
        result[0] += np.outer(self._shared_m, self._shared_m) * in_zone.prod(axis=-1)
        result[0] += np.diag(self.range_stddev_m**2 - self._shared_m**2 + errors.range_m**2)
        for axis in range(2):
            spread = np.hypot(self.spread_rad[:, axis], errors.bearing_rad)
            result[1 + axis] += np.outer(spread, spread) * in_zone[..., axis]
            result[1 + axis] += errors.turn_rad**2 * pose[2 - axis]
            result[1 + axis] += np.diag(0.1 * spread**2)
        return result
