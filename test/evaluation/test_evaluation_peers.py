# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math
from typing import Any

import numpy as np
import pytest

from evaluation.peers.camera import Background, Pose, expose, facing_pose, paper_electrons
from evaluation.peers.visual_markers import (
    APRILTAG,
    APRILTAG_FINE,
    IDS,
    QR,
    AprilTagReader,
    Reader,
    View,
    find_readers,
    read_pictures,
)

pytest.importorskip('pyapriltags', reason='needs pyapriltags, which is a pip extra')
READERS = {reader.name: reader for reader in find_readers()[0]}
ALL = pytest.mark.parametrize(
    'name',
    [
        pytest.param(
            name, marks=pytest.mark.skipif(name not in READERS, reason=f'no reader of {name}')
        )
        for name in (APRILTAG, APRILTAG_FINE, QR)
    ],
)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


@pytest.fixture(scope='module')
def background() -> Background:
    return Background(np.random.default_rng(0))


def pose_at(range_m: float, rng: np.random.Generator) -> Pose:
    return facing_pose(range_m, 300, math.radians(10), rng)


def test_photoelectrons_follow_light_and_time() -> None:
    # By hand: 100 lux on paper of 0.9 through f/1.8 with 0.9 of the light leave 6.25 lux; for
    # 1/30 s on (1/300 mm)², half of 683 W⁻¹ lm of 555 nm photons count.
    photons_j = 6.62607e-34 * 2.99792e8 / 555e-9
    expected = 0.5 * 6.25 / 683 / photons_j * (1e-3 / 300) ** 2 / 30
    assert paper_electrons(100, 1 / 30) == pytest.approx(expected, rel=1e-4)
    assert paper_electrons(50, 1 / 60) == pytest.approx(expected / 4, rel=1e-4)


@ALL
def test_a_clean_picture_gives_id_and_range(
    name: str, background: Background, rng: np.random.Generator
) -> None:
    reader = READERS[name]
    for identity in (0, 42, IDS - 1):
        plate = reader.plate(identity, 0.03)
        light, window = background.with_plate(plate.cells, plate.side_m, pose_at(0.5, rng))
        (seen,) = reader.read(expose(light, 300, rng), window.centre_px, 0.03)
        assert seen.id == identity
        assert seen.range_m == pytest.approx(0.5, rel=0.01)


class Liar(AprilTagReader):
    """Reads another ID than is there."""

    def read(self, picture: Any, centre_px: Any, size_m: float) -> Any:
        (seen,) = super().read(picture, centre_px, size_m)
        return [seen._replace(id=seen.id + 1)]


def test_wrong_ids_are_counted(background: Background, rng: np.random.Generator) -> None:
    readers: list[Reader] = [READERS[APRILTAG], Liar('liar', 2.0)]
    results = read_pictures(readers, background, 4, rng, View(0.6))
    assert (results[APRILTAG]['right']['hits'], results[APRILTAG]['wrong']['hits']) == (4, 0)
    assert (results['liar']['right']['hits'], results['liar']['wrong']['hits']) == (0, 4)
    assert results['liar']['error_mm'] is None
