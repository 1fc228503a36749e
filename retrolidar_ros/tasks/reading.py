# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A reading of a marker with the pose of its sensor, and the correlation of errors."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats

_UNIT, _MAX_AWAY_M = 1e-6, 1e7


class SensorPose(NamedTuple):
    """Where a sensor was in the fixed frame."""

    position_m: Floats  # shape (3,)
    rotation: Floats  # turns directions of the optical frame into those of the fixed one, (3, 3)


class Reading(NamedTuple):
    """One reading of one marker by one sensor."""

    marker: int
    sensor: str  # what identifies the sensor, such as its frame
    stamp_s: float
    range_m: float
    range_stddev_m: float
    direction: Floats  # unit vector in the sensor's optical frame, shape (3,)
    spread_rad: Floats  # deviations of the direction along the rows of `axes_of`, shape (2,)
    pose: SensorPose


def axes_of(direction: Floats) -> Floats:
    """Return two unit vectors across each direction (..., 3), the first near x: (..., 2, 3)."""
    across = np.array([1.0, 0.0, 0.0]) - direction[..., :1] * direction
    across /= np.sqrt((across * across).sum(axis=-1, keepdims=True))
    axes: Floats = np.empty((*direction.shape[:-1], 2, 3))
    axes[..., 0, :] = across
    # Their cross product; that of numpy takes as long as all else.
    later, sooner = (1, 2, 0), (2, 0, 1)
    axes[..., 1, :] = (
        direction[..., later] * across[..., sooner] - direction[..., sooner] * across[..., later]
    )
    return axes


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
    """Return a possible detection as a reading; ValueError for a pose that is none.

    Of the marker's position in the sensor's frame, shape (3,) [m], the direction counts; of its
    covariance, shape (3, 3) [m²], what is across that, the box of a zone. The rest is as in
    `Reading`.
    """
    off = float(np.abs(pose.rotation @ pose.rotation.T - np.eye(3)).max())
    if not (off < _UNIT and np.abs(pose.position_m).max() < _MAX_AWAY_M):  # nor NaN
        raise ValueError(f'the transform of the sensor is no pose: {sensor}')
    length_m = float(np.linalg.norm(position_m))
    direction = position_m / length_m
    axes = axes_of(direction)
    variance = ((axes @ covariance) * axes).sum(axis=1) / length_m**2
    spread = np.sqrt(np.maximum(variance, 1e-8))
    return Reading(marker, sensor, stamp_s, range_m, range_stddev_m, direction, spread, pose)


@dataclass(frozen=True)
class Errors:
    """Standard deviations of errors that readings share, besides the independent ones."""

    range_bias_m: float = 0.002  # of a sensor's range in all its readings; a calibration narrows it
    range_m: float = 0.0005  # of a range, in addition to its own
    box_rad: float = 0.0175  # limit of a direction beyond its box, by lens and mounting
    edge_rad: float = 0.009  # how soft the edges of that box are
    pose_m: float = 0.002  # of the sensor's position, along each axis
    turn_rad: float = 0.0035  # of the sensor's orientation, about each axis
    acceleration: float = 0.0  # of a moving marker, along each axis [m/s²]; 0: it is at rest
    speed: float = 0.5  # of a moving marker, along each axis [m/s]


# Share of the variance of a range that its readings from one place have in common: a background or
# another marker in the zone shifts them in the same way.
_SHARED = 0.25
_LASTING_S = 3.0  # correlation time of the acceleration of a moving marker
_SILENT_S = 2.0  # a sensor without a reading for so long does not see the marker
_ALIKE_M = 0.05  # distance within which the errors of a sensor correlate [m]


class Readings:
    """Arrays of the readings that one estimate is made of, and what their errors share."""

    def __init__(self, readings: Sequence[Reading], errors: Errors) -> None:
        self._errors = errors
        self.marker = np.array([one.marker for one in readings])
        self.range_m = np.array([one.range_m for one in readings])
        self.range_stddev_m = np.array([one.range_stddev_m for one in readings])
        self.spread_rad = np.array([one.spread_rad for one in readings])
        stamp_s = np.array([one.stamp_s for one in readings])
        self.sensor_m = np.array([one.pose.position_m for one in readings])
        rotation = np.array([one.pose.rotation for one in readings])
        direction = np.array([one.direction for one in readings])
        own = np.concatenate([axes_of(direction), direction[:, None]], axis=1)
        axes = own @ rotation.swapaxes(1, 2)
        self.axes = axes[:, :2]  # across the directions, in the fixed frame, shape (n, 2, 3)
        self.direction = axes[:, 2]  # as measured, in the fixed frame, shape (n, 3)
        sensor = np.array([one.sensor for one in readings])
        self.stamp_s = float(stamp_s.max())
        """When the estimate holds: if the marker moves, up to when all sensors have reported."""
        if errors.acceleration:
            newest_s = np.array([stamp_s[sensor == one].max() for one in set(sensor.tolist())])
            self.stamp_s = float(newest_s[newest_s > self.stamp_s - _SILENT_S].min())
        self.before_s = self.stamp_s - stamp_s  # how long before that each was taken
        self._moved_m2 = errors.acceleration**2 * _wandered(self.before_s)
        apart = np.linalg.norm(self.sensor_m[:, None] - self.sensor_m, axis=-1)
        self._one_sensor = sensor[:, None] == sensor
        self._one_pose = self._one_sensor * np.exp(-0.5 * (apart / _ALIKE_M) ** 2)
        self._one_marker = self.marker[:, None] == self.marker
        shared = _SHARED * self._one_pose * self._one_marker
        np.fill_diagonal(shared, 1.0)
        self._own_m2 = shared * np.outer(self.range_stddev_m, self.range_stddev_m)

    def range_covariance(self, sight_m: Floats, place_variance: Floats) -> Floats:
        """Return the covariance of the errors of all ranges, shape (n, n) [m²].

        All is in the fixed frame: `sight_m` leads from the sensors to where the markers are thought
        to be, shape (n, 3), and `place_variance` (n, 3, 3) is of the markers' places on their
        object [m²].
        """
        errors = self._errors
        unit = sight_m / np.linalg.norm(sight_m, axis=1)[:, None]
        result: Floats = (errors.pose_m**2 * self._one_pose + self._moved_m2) * (unit @ unit.T)
        result += errors.range_bias_m**2 * self._one_sensor + self._own_m2
        if place_variance.any():
            result += (unit[:, None] @ place_variance @ unit.T)[:, 0] * self._one_marker
        result.flat[:: len(result) + 1] += errors.range_m**2
        return result

    def edge_variance(self, range_m: Floats) -> Floats:
        """Return the variance of the edges of boxes, shape (n, 1) [rad²], for ranges (n,) [m]."""
        errors = self._errors
        across_m2 = errors.pose_m**2 + np.diag(self._moved_m2)
        variance = errors.edge_rad**2 + errors.turn_rad**2 + across_m2 / range_m**2
        return variance[:, None]


def _wandered(before_s: Floats) -> Floats:
    """Return the covariance of displacements for an acceleration of variance 1 [s⁴].

    It is a Gauss-Markov process, whose correlation falls off in `_LASTING_S` (Singer 1970). Times
    before and after that of the estimate have opposite signs.
    """
    tau, apart_s = _LASTING_S, np.abs(before_s)
    short, long = np.minimum.outer(apart_s, apart_s), np.maximum.outer(apart_s, apart_s)
    white = tau * short**2 * (long - short / 3)
    early = (long + tau) * (short + tau * np.expm1(-short / tau))
    late = tau * (np.exp((short - long) / tau) - np.exp(-long / tau))
    late -= short * np.exp(-long / tau)
    same = white - tau**2 * early + tau**3 * late
    across = tau * (apart_s + tau * np.expm1(-apart_s / tau))
    wandered: Floats = np.where(np.outer(before_s, before_s) < 0, np.outer(across, across), same)
    return wandered
