# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Cameras by their optics, and what readers of visual markers find in their pictures."""

import ctypes.util
import sys
from typing import Any

import numpy as np
import pytest

from evaluation.peers import camera
from evaluation.peers.visual_markers import (
    APRILTAG,
    APRILTAG_FINE,
    QR,
    AprilTagReader,
    View,
    find_readers,
    read_pictures,
)

pytest.importorskip('pyapriltags', reason='needs pyapriltags, which is a pip extra')
READERS = {reader.name: reader for reader in find_readers()[0]}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_photoelectrons_follow_light_and_time() -> None:
    # By hand: 100 lux on paper of 0.9 through f/1.8 with 0.9 of the light leave 6.25 lux; for
    # 1/30 s on (1/300 mm)², half of 683 W⁻¹ lm of 555 nm photons count.
    photons_j = 6.62607e-34 * 2.99792e8 / 555e-9
    expected = 0.5 * 6.25 / 683 / photons_j * (1e-3 / 300) ** 2 / 30
    assert camera.paper_electrons(100, 1 / 30) == pytest.approx(expected, rel=1e-4)
    assert camera.paper_electrons(50, 1 / 60) == pytest.approx(expected / 4, rel=1e-4)


def test_missing_zbar_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in [name for name in sys.modules if name.startswith('pyzbar')]:
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.setattr(ctypes.util, 'find_library', lambda name: None)
    readers, missing = find_readers()
    assert [reader.name for reader in readers] == [APRILTAG, APRILTAG_FINE]
    assert list(missing) == [QR]
    assert 'apt install libzbar0' in missing[QR]


class Liar(AprilTagReader):
    """Reads another ID than is there."""

    def read(self, picture: Any, centre_px: Any, size_m: float) -> Any:
        (seen,) = super().read(picture, centre_px, size_m)
        return [seen._replace(id=seen.id + 1)]


def test_right_and_wrong_ids_are_counted(rng: np.random.Generator) -> None:
    liar = Liar('liar', 2.0)
    results = read_pictures([*READERS.values(), liar], camera.Background(rng), 4, rng, View(0.6))
    for name in READERS:
        found = results[name]
        assert (found['right']['hits'], found['wrong']['hits']) == (4, 0)
        assert found['error_mm'] is not None
        assert found['error_mm']['largest'] < 6
    found = results[liar.name]
    assert (found['right']['hits'], found['wrong']['hits']) == (0, 4)
    assert found['error_mm'] is None


@pytest.mark.parametrize(
    ('view', 'hits'),
    [
        (View(1.0), 5),
        (View(1.0, lux=0.01), 0),
        (View(1.0, yaw_deg=85), 0),
        (View(1.0, pitch_deg=85), 0),
        (View(1.0, speed_m_s=0.6), 0),
    ],
)
def test_tags_end_dark_turned_and_blurred(view: View, hits: int, rng: np.random.Generator) -> None:
    results = read_pictures([READERS[APRILTAG]], camera.Background(rng), 5, rng, view)
    assert results[APRILTAG]['right']['hits'] == hits
