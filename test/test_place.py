# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from retrolidar_ros.detector.place import facing_sensor, place_in_zone
from retrolidar_ros.frame import Floats, ZoneGrid

GRIDS = [ZoneGrid(4, 4), ZoneGrid(8, 8)]


def rotate(quaternion: Floats, vector: Floats) -> Floats:
    axis, w = quaternion[:3], quaternion[3]
    rotated: Floats = vector + 2 * np.cross(axis, np.cross(axis, vector) + w * vector)
    return rotated


@pytest.mark.parametrize('grid', GRIDS)
def test_position_is_along_the_zone_at_the_radial_range(grid: ZoneGrid) -> None:
    for zone in range(grid.zones):
        place = place_in_zone(zone, 1.5, 0.01, grid)
        assert place.range_m == pytest.approx(1.5 / grid.z_per_range[zone])
        assert np.linalg.norm(place.position_m) == pytest.approx(place.range_m)
        assert place.position_m[:2] / place.position_m[2] == pytest.approx(grid.tangents[zone])
        assert place.range_stddev_m == pytest.approx(0.01 / grid.z_per_range[zone])


@pytest.mark.parametrize('grid', GRIDS)
def test_orientation_faces_the_sensor(grid: ZoneGrid) -> None:
    for direction in grid.directions:
        quaternion = facing_sensor(direction)
        assert np.linalg.norm(quaternion) == pytest.approx(1)
        assert rotate(quaternion, np.array([0.0, 0.0, 1.0])) == pytest.approx(direction)
    assert facing_sensor(np.array([0.0, 0.0, 1.0])) == pytest.approx([0, 0, 0, 1])


@pytest.mark.parametrize('grid', GRIDS)
def test_covariance_is_that_of_markers_anywhere_in_the_zone(grid: ZoneGrid) -> None:
    rng = np.random.default_rng(1)
    for zone in (0, grid.columns + 1, grid.zones - 1):
        place = place_in_zone(zone, 1.5, 0.01, grid)
        offsets = grid.pitch * rng.uniform(-0.5, 0.5, (20_000, 2))
        rays = np.concatenate([grid.tangents[zone] + offsets, np.ones((20_000, 1))], axis=-1)
        rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
        ranges = place.range_m + place.range_stddev_m * rng.standard_normal((20_000, 1))
        sampled = np.cov((ranges * rays).T)
        scale = np.sqrt(np.outer(np.diag(sampled), np.diag(sampled)))
        assert np.abs(place.covariance[:3, :3] - sampled).max() < 0.06 * scale.max()
        along = grid.directions[zone] @ place.covariance[:3, :3] @ grid.directions[zone]
        assert along == pytest.approx(place.range_stddev_m**2)


def test_covariance_is_symmetric_and_positive_definite() -> None:
    place = place_in_zone(3, 2.0, 0.002, GRIDS[0])
    assert place.covariance == pytest.approx(place.covariance.T)
    assert np.linalg.eigvalsh(place.covariance).min() > 0
    # Roll about the line of sight is not seen at all, tilt hardly.
    direction = GRIDS[0].directions[3]
    assert direction @ place.covariance[3:, 3:] @ direction == pytest.approx(np.pi**2 / 3)
