# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot is among markers at known places.

To a robot, the room is an object of several markers: where that is in the robot's own frame says
where the robot is in the room.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import cross_matrix
from retrolidar_ros.tasks.landmarks import Estimate, Landmark
from retrolidar_ros.tasks.reading import Errors, Prior, State

# Deviations of a robot on a floor from its plane [m] and from level [rad], and of all else.
_LEVEL_M, _LEVEL = 0.01, 0.01
_FAR_M, _ANY_TURN = 100.0, 100.0
# A pose is clear up to such deviations: beyond, it is on a circle, or is one of two [m], [rad].
_CLEAR_M, _CLEAR = 0.2, 0.5


class RobotPose(NamedTuple):
    """Where a robot's base is in the frame of the markers."""

    position_m: Floats  # shape (3,)
    rotation: Floats  # turns directions of the base into those of the markers' frame, shape (3, 3)
    covariance: Floats  # of position [m²] and rotation about that frame's axes [rad²], (6, 6)


def room_of(
    known: Mapping[str, Prior],
    objects: Mapping[str, Mapping[int, Floats]],
    errors: Errors,
    *,
    flat: bool = False,
) -> Landmark:
    """Return a room as one landmark; ValueError if fewer than three markers are known.

    Objects are known by name, and their markers with places on them, shape (3,) [m]. If it is flat,
    the robot's frame is level and at the height of the room's.
    """
    places, variances = {}, {}
    for name, prior in known.items():
        for marker, on_object_m in objects.get(name, {}).items():
            arm_m = prior.state.rotation @ on_object_m
            per_pose = np.hstack([np.eye(3), -cross_matrix(arm_m)])
            places[marker] = prior.state.position_m + arm_m
            variances[marker] = per_pose @ prior.covariance @ per_pose.T
    if len(places) < 3:
        raise ValueError(f'{len(places)} markers are at known places; localisation needs three')
    level = None
    if flat:
        state = State(np.zeros(3), np.eye(3), np.zeros(3))
        level = Prior(state, np.diag([_FAR_M, _FAR_M, _LEVEL_M, _LEVEL, _LEVEL, _ANY_TURN]) ** 2)
    return Landmark('room', places, errors, level, variances)


def robot_pose(room: Estimate, base_m: Floats, base_rotation: Floats) -> RobotPose | None:
    """Return where the base is in a room, from where both are in the fixed frame.

    Of the base, place [m] and rotation into that frame are given. It is None while that is not
    clear: among one or two markers it can be anywhere on a circle, and ranges of three can have two
    answers, which no covariance tells well.
    """
    back = room.rotation.T
    arm_m = base_m - room.position_m
    jacobian = np.block([[-back, back @ cross_matrix(arm_m)], [np.zeros((3, 3)), -back]])
    covariance = jacobian @ room.covariance @ jacobian.T
    if largest_stddev(covariance[:3, :3]) > _CLEAR_M or largest_stddev(covariance[3:, 3:]) > _CLEAR:
        return None
    return RobotPose(back @ arm_m, back @ base_rotation, covariance)
