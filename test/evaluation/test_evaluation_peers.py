# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import ctypes.util
import math
import sys
from typing import Any

import numpy as np
import pytest

from evaluation.peers.camera import (
    CENTRE_PX,
    Background,
    Pose,
    expose,
    exposure_s,
    facing_pose,
    paper_electrons,
    smear,
    tilted,
    transform,
)
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
    square_range,
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
SQUARE = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])


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


def test_the_tag_is_where_the_homography_puts_it(
    background: Background, rng: np.random.Generator
) -> None:
    reader = READERS[APRILTAG]
    assert isinstance(reader, AprilTagReader)
    for _ in range(5):
        plate, pose = reader.plate(7, 0.03), pose_at(0.4, rng)
        light, window = background.with_plate(plate.cells, plate.side_m, pose)
        (tag,) = reader.detector.detect(expose(light, 300, rng))
        border_m = 0.03 * 5 / 9
        corners = transform(pose.homography, border_m * SQUARE) - (window.left, window.top)
        # The library begins at the lower left one.
        assert np.abs(tag.corners - corners[[3, 2, 1, 0]]).max() < 0.5


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


def test_the_range_of_a_square_holds_when_it_is_tilted(rng: np.random.Generator) -> None:
    for yaw_deg in (0, 20, 40):
        pose = tilted(pose_at(1.0, rng), math.radians(yaw_deg), 0.0)
        corners = transform(pose.homography, 0.03 * SQUARE)
        assert square_range(corners, CENTRE_PX, 0.03) == pytest.approx(1.0, rel=0.001)


def test_missing_zbar_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.startswith('pyzbar')]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(ctypes.util, 'find_library', lambda name: None)
    readers, missing = find_readers()
    assert [reader.name for reader in readers] == [APRILTAG, APRILTAG_FINE]
    assert list(missing) == [QR]
    assert 'zbar' in missing[QR]
    assert 'apt install libzbar0' in missing[QR]


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


@pytest.mark.parametrize(
    'view',
    [View(1.0, lux=0.01), View(1.0, yaw_deg=85), View(1.0, pitch_deg=85), View(1.0, speed_m_s=0.6)],
)
def test_tags_end_in_the_dark_turned_away_and_blurred(
    view: View, background: Background, rng: np.random.Generator
) -> None:
    usual, worse = (
        read_pictures([READERS[APRILTAG]], background, 5, rng, one)[APRILTAG]['right']['hits']
        for one in (View(1.0), view)
    )
    assert (usual, worse) == (5, 0)


def test_a_short_exposure_is_sharp() -> None:
    assert exposure_s(300, 1 / 250) == 1 / 250
    assert exposure_s(30_000) < 1 / 1000
    edge = np.tile(np.repeat([0.0, 1.0], 50), (3, 1))
    spread = smear(edge, 7.5)
    assert ((spread[0] > 1e-9) & (spread[0] < 1 - 1e-9)).sum() == pytest.approx(7.5, abs=1)
