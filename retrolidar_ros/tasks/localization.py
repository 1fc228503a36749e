# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot is among markers at known places.

To a robot, the room is an object of several markers: where that is in the robot's own frame says
where the robot is in the room.
"""

from collections.abc import Mapping

import numpy as np

from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.detector.findings import listed
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import cross_matrix
from retrolidar_ros.tasks.landmarks import Estimate, Landmark
from retrolidar_ros.tasks.reading import Errors, KnownPose

# Deviations of a robot on a floor from its plane [m] and from level [rad], and of all else.
_LEVEL_M, _LEVEL = 0.01, 0.01
_FAR_M, _ANY_TURN = 100.0, 100.0
# A pose is clear up to such deviations: beyond, it is on a circle, or is one of two [m], [rad].
_CLEAR_M, _CLEAR = 0.2, 0.5


def room_of(
    known: Mapping[str, KnownPose],
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
    for name, pose in known.items():
        for marker, on_object_m in objects.get(name, {}).items():
            arm_m = pose.rotation @ on_object_m
            per_pose = np.hstack([np.eye(3), -cross_matrix(arm_m)])
            places[marker] = pose.position_m + arm_m
            variances[marker] = per_pose @ pose.covariance @ per_pose.T
    if len(places) < 3:
        lacking = 'load_file has none'
        if known:
            lacking = f'load_file has {len(known)} landmarks'
        if unmarked := sorted(known.keys() - objects.keys()):
            lacking += f', of which {len(unmarked)} are not in marker_file: {listed(unmarked)}'
        text = f'{len(places)} markers are at known places; localisation needs three'
        raise ValueError(f'{text}: {lacking}')
    level = None
    if flat:
        spread = np.diag([_FAR_M, _FAR_M, _LEVEL_M, _LEVEL, _LEVEL, _ANY_TURN]) ** 2
        level = KnownPose(np.zeros(3), np.eye(3), spread)
    return Landmark('room', places, errors, level, variances)


def robot_pose(room: Estimate, base_m: Floats, base_rotation: Floats) -> KnownPose | None:
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
    return KnownPose(back @ arm_m, back @ base_rotation, covariance)
