# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Pose and motion of an object in the fixed frame: prior and estimate."""

from dataclasses import dataclass

from retrolidar_ros.sensor.frame import Floats


@dataclass(frozen=True, eq=False)
class State:
    """Pose and motion of an object in the fixed frame."""

    position_m: Floats  # shape (3,)
    rotation: Floats  # turns directions of the object into those of the fixed frame, shape (3, 3)
    velocity: Floats  # shape (3,) [m/s]


@dataclass(frozen=True, eq=False)
class Prior:
    """A pose that is known before any reading."""

    state: State
    covariance: Floats  # of position [m²] and rotation about the fixed axes [rad²], shape (6, 6)


@dataclass(frozen=True, eq=False)
class Fit:
    """An estimate, and how well each reading agrees with it."""

    state: State
    covariance: Floats  # of position, rotation about the fixed axes and velocity, shape (9, 9)
    stamp_s: float  # when it holds
    scores: Floats  # residuals in deviations, of range and of directions beyond their box, (n, 3)
