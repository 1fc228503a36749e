# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How an object is in the fixed frame, and what was known of that before."""

from __future__ import annotations

from dataclasses import dataclass

from retrolidar_ros.sensor.frame import Floats


@dataclass(frozen=True, eq=False)
class State:
    """Pose and motion of an object in the fixed frame."""

    position_m: Floats
    """Shape (3,)."""
    rotation: Floats
    """Turns directions of the object into those of the fixed frame, shape (3, 3)."""
    velocity: Floats
    """Shape (3,) [m/s]."""


@dataclass(frozen=True, eq=False)
class Prior:
    """What was known of a pose before any reading."""

    state: State
    covariance: Floats
    """Of position [m²] and rotation about the fixed axes [rad²], shape (6, 6)."""
