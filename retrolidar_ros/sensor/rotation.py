# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rotations as unit quaternions (x, y, z, w)."""

import itertools

import numpy as np

from retrolidar_ros.sensor.frame import Floats

_CROSS: Floats = np.cross(np.eye(3)[:, None], np.eye(3)).swapaxes(1, 2)
"""What multiplies as the cross product with each axis does, shape (3, 3, 3)."""


def matrix_of(quaternion: Floats) -> Floats:
    """Return the rotation matrix, shape (3, 3), of a quaternion of shape (4,)."""
    unit = quaternion / np.linalg.norm(quaternion)
    cross = cross_matrix(unit[:3])
    matrix: Floats = np.eye(3) + 2 * unit[3] * cross + 2 * cross @ cross
    return matrix


def quaternion_of(matrix: Floats) -> Floats:
    """Return the quaternion (4,) of a rotation matrix (3, 3), by Bar-Itzhack 2000."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix
    symmetric = np.array(
        [
            [xx - yy - zz, xy + yx, xz + zx, zy - yz],
            [xy + yx, yy - xx - zz, yz + zy, xz - zx],
            [xz + zx, yz + zy, zz - xx - yy, yx - xy],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    return np.linalg.eigh(symmetric)[1][:, -1]


def matrix_of_turn(turn: Floats) -> Floats:
    """Return the rotation matrix of a rotation vector, shape (3,) [rad] (Rodrigues)."""
    angle = max(float(np.linalg.norm(turn)), 1e-12)
    cross = cross_matrix(turn / angle)
    matrix: Floats = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return matrix


def turn_of(matrix: Floats) -> Floats:
    """Return the rotation vector, shape (3,) [rad], of a rotation matrix of shape (3, 3)."""
    quaternion = quaternion_of(matrix)
    sine = float(np.linalg.norm(quaternion[:3]))
    angle = 2 * np.arctan2(sine, abs(quaternion[3]))
    turn: Floats = angle * np.copysign(1, quaternion[3]) * quaternion[:3] / max(sine, 1e-12)
    return turn


def cross_matrix(vectors: Floats) -> Floats:
    """Return the matrices that multiply as the cross product with vectors (..., 3) does."""
    return (vectors @ _CROSS.reshape(3, 9)).reshape(*vectors.shape, 3)


_FLIPS = [
    np.diag(signs) @ np.eye(3)[list(order)]
    for order in itertools.permutations(range(3))
    for signs in itertools.product((1.0, -1.0), repeat=3)
]
_TURNS = [one for one in _FLIPS if np.linalg.det(one) > 0]
QUARTER_TURNS = sorted(_TURNS, key=lambda turn: -float(np.trace(turn)))
"""The 24 rotations that turn a cube into itself, the least first."""
