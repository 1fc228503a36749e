# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a sensor has to go for a landmark to be known best."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.landmarks import Landmark

_DIRECTIONS = 8


class Move(NamedTuple):
    """A step of the sensor across its line of sight."""

    step_m: Floats
    """In the fixed frame, shape (3,)."""
    stddev_m: float
    """Deviation of the landmark, along its worst axis, with a reading from there."""


def best_move(landmark: Landmark, length_m: float) -> Move | None:
    """Return the step of a length [m] after which one more reading says most; None without any.

    All steps across the line of sight of the last reading are tried, and the range that would be
    read: a step along it would change the range only, which is known.
    """
    if landmark.fit is None or not landmark.members:
        return None
    last = max(landmark.members, key=lambda one: one.stamp_s)
    sight = last.place_m() - last.pose.position_m
    axes = np.linalg.svd(sight[None] / np.linalg.norm(sight))[2][1:]
    moves = []
    for turn in np.arange(_DIRECTIONS) * 2 * math.pi / _DIRECTIONS:
        step_m = length_m * (math.cos(turn) * axes[0] + math.sin(turn) * axes[1])
        there = last._replace(pose=last.pose._replace(position_m=last.pose.position_m + step_m))
        worst = float(np.linalg.eigvalsh(landmark.spread_with([there]))[-1])
        moves.append(Move(step_m, math.sqrt(worst)))
    return min(moves, key=lambda move: move.stddev_m)
