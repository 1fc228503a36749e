# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Zones look where the geometry says, rotations turn, recordings hold frames, noise has its law."""

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest
from harness_frames import GRID, both_grids, make_frames
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from retrolidar_ros.core import ffi
from retrolidar_ros.detector.likelihood_detector import core_sensor
from retrolidar_ros.sensor.frame import (
    Floats,
    Frame,
    Recording,
    ZoneGrid,
    missing_frames,
    stamps_stand,
    valid_samples,
)
from retrolidar_ros.sensor.model import VL53L8CX, NoiseLaw, SensorModel, Status
from retrolidar_ros.sensor.rotation import matrix_of, quaternion_of


@pytest.mark.parametrize(
    ('grid', 'centres_deg'),
    [
        (GRID, [-17.87, -6.135, 6.135, 17.87]),
        (ZoneGrid(8, 8), [-20.62, -15.04, -9.16, -3.08, 3.08, 9.16, 15.04, 20.62]),
    ],
)
def test_zone_centres_are_those_of_the_sensor(grid: ZoneGrid, centres_deg: list[float]) -> None:
    angles_deg = np.rad2deg(np.arctan(grid.tangents)).reshape(grid.rows, grid.columns, 2)
    across, down = np.meshgrid(centres_deg, centres_deg)
    np.testing.assert_allclose(angles_deg, np.stack([across, down], axis=-1), atol=0.006)
    edge = grid.tangents.max() + grid.pitch / 2
    assert 2 * np.rad2deg(np.arctan(edge)) == pytest.approx(46.5, abs=0.05)
    assert 2 * np.rad2deg(np.arctan(np.sqrt(2) * edge)) == pytest.approx(62.6, abs=0.1)


@both_grids
def test_depth_per_range_is_that_of_the_sensor_and_of_a_walls_mean_range(grid: ZoneGrid) -> None:
    corner, edge, inner = 0.9072, 0.9438, 0.9851
    outer, middle = [corner, edge, edge, corner], [edge, inner, inner, edge]
    expected = [*outer, *middle, *middle, *outer]
    np.testing.assert_allclose(GRID.z_per_range, expected, atol=2e-4)
    rng = np.random.default_rng(2)
    inside = grid.pitch * rng.uniform(-0.5, 0.5, (20_000, 1, 2))
    ranges_m = 2.5 * np.sqrt(1 + ((grid.tangents + inside) ** 2).sum(axis=-1))
    np.testing.assert_allclose(grid.z_per_range * ranges_m.mean(axis=0), 2.5, rtol=1e-3)


@pytest.mark.parametrize('shape', [(4, 8), (8, 4), (0, 0), (1, 16), (-4, -4), (16, 16)])
def test_shapes_that_the_sensor_has_not(shape: tuple[int, int]) -> None:
    with pytest.raises(ValueError, match=f'{shape[0]}x{shape[1]} zones: the sensor has 4x4 or 8x8'):
        ZoneGrid(*shape)


@both_grids
def test_a_recording_gives_back_its_frames(grid: ZoneGrid) -> None:
    stamps_ns = [0, 1, 2**53 + 1, 2**62 + 3, 2**63 - 1]  # to the nanosecond
    frames = [
        replace(frame, stamp_ns=stamp_ns, sensor_time_us=stamp_ns // 1000)
        for frame, stamp_ns in zip(make_frames(5, grid.rows), stamps_ns, strict=True)
    ]
    frames[4] = replace(frames[4], sequence=2**32 - 1)
    recording = Recording.of(frames)
    assert len(recording) == 5
    assert recording.stamp_ns.dtype == np.int64
    assert recording.distance.shape == (5, grid.zones)
    for frame, expected in zip(recording, frames, strict=True):
        for field in fields(Frame):
            actual, wanted = getattr(frame, field.name), getattr(expected, field.name)
            assert type(actual) is type(wanted)
            assert getattr(actual, 'dtype', None) == getattr(wanted, 'dtype', None)
            np.testing.assert_equal(actual, wanted)


def test_recordings_that_cannot_be() -> None:
    good = make_frames(1)[0]
    bad = replace(good, signal=make_frames(1, 8)[0].signal)
    for frames, message in (
        ([], 'at least one frame'),
        ([good, *make_frames(1, 8)], 'different zone grids'),
        ([good, bad], 'shape'),
    ):
        with pytest.raises(ValueError, match=message):
            Recording.of(frames)


@pytest.mark.parametrize(
    ('signal', 'distance', 'status', 'is_valid', 'is_impossible'),
    [
        (10.0, 1.0, Status.VALID, True, False),
        (0.0, 8.19, Status.FIRST_RANGE, True, False),
        (10.0, np.nan, Status.MERGED, True, False),  # no target is a value like others
        (10.0, 8.192, Status.VALID, False, True),
        (10.0, 0.0, Status.NO_PREVIOUS_TARGET, False, True),
        (-0.1, 1.0, Status.VALID, False, True),
        (2.0**21 + 1, 1.0, Status.VALID, False, True),
        (np.nan, 1.0, Status.VALID, False, True),
        (10.0, 1.0, Status.SIGMA_TOO_HIGH, False, False),
        (-0.1, 9.0, Status.NO_TARGET, False, False),
    ],
)
def test_samples_are_valid_if_their_status_is_and_they_are_possible(
    signal: float, distance: float, status: Status, is_valid: bool, is_impossible: bool
) -> None:
    given = np.array([signal]), np.array([distance]), np.array([status], dtype=np.uint8)
    valid, impossible = valid_samples(*given)
    assert (valid.tolist(), impossible) == ([is_valid], is_impossible)


@pytest.mark.parametrize(
    ('floor', 'slope'), [(0.0, 0.2), (-1.0, 0.2), (1.0, -0.1), (np.nan, 0.2), (1.0, np.nan)]
)
def test_a_law_that_allows_no_noise_is_refused(floor: float, slope: float) -> None:
    with pytest.raises(ValueError, match='the floor must be positive'):
        NoiseLaw(floor, slope)


def test_ambient_light_raises_the_floor() -> None:
    law = NoiseLaw()
    lit = law.lit(10.0)
    assert lit.variance(np.array(0.0)) == pytest.approx(law.floor + 10 * law.ambient)
    assert lit.slope == law.slope
    assert law.lit([3.0, np.nan, np.inf, -5.0]).floor == law.floor + 0.75 * law.ambient


@pytest.mark.parametrize('name', [field.name for field in fields(SensorModel)])
def test_the_core_is_told_every_field_of_a_sensor(name: str) -> None:
    def told(model: SensorModel) -> bytes:
        grid = ZoneGrid(4, 4, view=model.field_of_view)
        return bytes(ffi.buffer(core_sensor(model, grid)))

    other: dict[str, Any] = {'noise': NoiseLaw(9.0), 'valid': (1,), 'nothing': (2,), 'faint': (3,)}
    value = other[name] if name in other else 0.5 * getattr(VL53L8CX, name) + 0.1
    assert told(replace(VL53L8CX, **{name: value})) != told(VL53L8CX)


def test_missing_frames_are_counted_and_stamps_that_stand_are_known() -> None:
    top = 2**32
    pairs = [(None, 7), (3, 4), (3, 6), (top - 1, 0), (top - 2, 1), (5000, 0)]
    assert [missing_frames(*pair) for pair in pairs] == [0, 0, 2, 0, 2, 0]
    steps = [(10, 0), (10, -9_000_000), (9, 0), (10, 10_000_000), (9, 9_000_000)]
    assert [stamps_stand(*step) for step in steps] == [True, True, False, False, False]


@pytest.mark.parametrize('axis', [0, 1, 2])
def test_a_quarter_turn_is_right_handed(axis: int) -> None:
    own, after, last = np.roll(np.eye(3), -axis, axis=0)
    turned = matrix_of(np.append(own, 1.0))
    assert turned @ own == pytest.approx(own)
    assert turned @ after == pytest.approx(last)
    assert turned @ last == pytest.approx(-after)


@given(hnp.arrays(np.float64, 4, elements=st.floats(-1, 1)))
def test_matrices_are_rotations_and_all_come_back_up_to_a_sign(values: Floats) -> None:
    assume(np.linalg.norm(values) > 0.01)
    quaternion = values / np.linalg.norm(values)
    matrix = matrix_of(quaternion)
    assert matrix @ matrix.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)
    found = quaternion_of(matrix)
    assert found.shape == (4,)
    assert np.linalg.norm(found) == pytest.approx(1)
    assert abs(found @ quaternion) == pytest.approx(1, abs=1e-9)
    assert matrix_of(found) == pytest.approx(matrix, abs=1e-9)
