# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings of markers, the errors that they share, and what is made of them: pose and motion."""

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


@dataclass(frozen=True, eq=False)
class State:
    """Pose and motion of an object in the fixed frame."""

    position_m: Floats  # shape (3,)
    rotation: Floats  # turns directions of the object into those of the fixed frame, shape (3, 3)
    velocity: Floats  # shape (3,) [m/s]


class KnownPose(NamedTuple):
    """A pose in a fixed frame, and how well it is known: an object's or a robot's."""

    position_m: Floats  # shape (3,)
    rotation: Floats  # turns directions of its own frame into those of the fixed one, shape (3, 3)
    covariance: Floats  # of position [m²] and rotation about the fixed axes [rad²], shape (6, 6)


@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate, and how well each reading agrees with it."""

    state: State
    covariance: Floats  # of position, rotation about the fixed axes and velocity, shape (9, 9)
    stamp_s: float  # when it holds
    scores: Floats  # residuals in deviations, of range and of directions beyond their box, (n, 3)
