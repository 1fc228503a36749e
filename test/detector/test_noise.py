# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The law of the sensor's noise, and how much of it the core finds."""

import numpy as np
import pytest
from harness_frames import recording_of

from retrolidar_ros.core import lib
from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.code import packet
from retrolidar_ros.sensor.frame import Floats, Status, ZoneGrid

GRID = ZoneGrid()
LAW = NoiseLaw()
FRAMES = 40 * 62


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


def learnt_scale(signal: Floats, status: Status = Status.VALID) -> float:
    """Return by how much noisier than the law the core takes the sensor for."""
    detector = create_detector('joint', GRID)
    assert isinstance(detector, LikelihoodDetector)
    stamp_ns = 21_000_000 * np.arange(len(signal))
    detector.update_all(recording_of(stamp_ns, np.maximum(signal, 0.0), status=status))
    return float(lib.rl_detector_held(detector._core).noise_scale)


@pytest.mark.parametrize(
    ('floor', 'slope'), [(0.0, 0.2), (-1.0, 0.2), (1.0, -0.1), (np.nan, 0.2), (1.0, np.nan)]
)
def test_a_law_that_allows_no_noise_is_refused(floor: float, slope: float) -> None:
    with pytest.raises(ValueError, match='the floor must be positive'):
        NoiseLaw(floor, slope)


def test_ambient_light_raises_the_floor() -> None:
    assert LAW.lit(10.0).variance(np.array(0.0)) == pytest.approx(LAW.floor + 10 * LAW.ambient)
    assert LAW.lit(10.0).slope == LAW.slope
    assert LAW.lit([3.0, np.nan, np.inf, -5.0]).floor == LAW.floor + 0.75 * LAW.ambient


@pytest.mark.parametrize('factor', [0.5, 1.0, 2.0])
def test_the_scale_of_the_noise_is_learnt(factor: float, rng: np.random.Generator) -> None:
    mean = np.linspace(20, 60, GRID.zones)
    deviation = np.sqrt(factor * LAW.variance(mean))
    signal = mean + deviation * rng.standard_normal((FRAMES, GRID.zones))
    assert learnt_scale(signal) == pytest.approx(factor, rel=0.15)


@pytest.mark.parametrize('amplitude', [30.0, 100.0])
def test_blinking_zones_do_not_pass_for_noise(amplitude: float, rng: np.random.Generator) -> None:
    ids = rng.integers(1, 4095, GRID.zones // 2)
    light = np.ones((FRAMES, GRID.zones))
    light[:, ::2] = np.tile(1 - np.repeat(packet(ids), 2, axis=1).T, (FRAMES // 62, 1))
    mean = 20 + amplitude * light
    noise = np.sqrt(LAW.variance(mean)) * rng.standard_normal(mean.shape)
    assert learnt_scale(mean + noise) == pytest.approx(1.0, rel=0.25)


def test_the_scale_is_not_learnt_from_erasures(rng: np.random.Generator) -> None:
    signal = 100 + 100 * np.abs(rng.standard_normal((FRAMES, GRID.zones)))
    assert learnt_scale(signal, Status.NO_TARGET) == 1.0
