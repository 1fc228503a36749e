# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of, matrix_of_turn, quaternion_of, turn_of

EXACT = 1e-12


def unit(values: tuple[float, ...]) -> Floats:
    quaternion: Floats = np.array(values) / np.linalg.norm(values)
    return quaternion


quaternions = (
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: bool(np.linalg.norm(q) > 0.01)).map(unit)
)


def turn(axis: int, angle_deg: float) -> Floats:
    quaternion = np.zeros(4)
    quaternion[axis] = np.sin(np.radians(angle_deg) / 2)
    quaternion[3] = np.cos(np.radians(angle_deg) / 2)
    return quaternion


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_a_quarter_turn_is_right_handed(axis: int) -> None:
    after, last = (axis + 1) % 3, (axis + 2) % 3
    turned = matrix_of(turn(axis, 90)) @ np.eye(3)
    assert turned[:, axis] == pytest.approx(np.eye(3)[axis])
    assert turned[:, after] == pytest.approx(np.eye(3)[last])
    assert turned[:, last] == pytest.approx(-np.eye(3)[after])


@given(quaternions)
def test_matrices_are_rotations_and_all_come_back_up_to_a_sign(quaternion: Floats) -> None:
    matrix = matrix_of(quaternion)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=EXACT)
    assert np.linalg.det(matrix) == pytest.approx(1)
    found = quaternion_of(matrix)
    assert found.shape == (4,)
    assert np.linalg.norm(found) == pytest.approx(1)
    assert abs(found @ quaternion) == pytest.approx(1, abs=1e-9)
    assert matrix_of(found) == pytest.approx(matrix, abs=1e-9)


@given(quaternions, st.floats(0.1, 10), st.sampled_from([-1, 1]))
def test_length_and_sign_do_not_matter(quaternion: Floats, length: float, sign: int) -> None:
    assert matrix_of(sign * length * quaternion) == pytest.approx(matrix_of(quaternion), abs=EXACT)


@given(axis=quaternions, angle=st.floats(0, np.pi - 1e-3))
def test_a_turn_of_less_than_half_is_found_in_its_matrix(axis: Floats, angle: float) -> None:
    length = np.linalg.norm(axis[:3])
    turned = angle * axis[:3] / length if length > 1e-3 else np.zeros(3)
    assert turn_of(matrix_of_turn(turned)) == pytest.approx(turned, abs=1e-6)
