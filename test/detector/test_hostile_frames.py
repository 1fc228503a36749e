# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames that hold what no sensor measures: erasures, that end nothing and place nothing."""

from dataclasses import replace

import numpy as np
import pytest

from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import MOST_DISTANCE_M, Frame

IMPOSSIBLE = (0.0, -0.5, -np.inf, np.inf, 3e38, 1e-40, 8.191)
FRAMES = list(Simulation(load_scene('coffee')).run(3.0))


def spoilt(frame: Frame, field: str, value: float, zones: str) -> Frame:
    values = getattr(frame, field).copy()
    if zones == 'all':
        values[:] = value
    elif zones == 'strongest':
        values[np.argmax(frame.signal)] = value
    else:
        rng = np.random.default_rng(frame.sequence)
        values[rng.random(len(values)) < 0.3] = value
    return replace(frame, **{field: values})


@pytest.mark.filterwarnings('error')
@pytest.mark.parametrize('zones', ['all', 'strongest', 'some'])
@pytest.mark.parametrize('field', ['distance', 'signal', 'ambient'])
@pytest.mark.parametrize('method', METHODS)
def test_impossible_values_end_nothing_and_place_nothing(
    method: str, field: str, zones: str
) -> None:
    for value in IMPOSSIBLE:
        detector = create_detector(method, FRAMES[0].grid)
        for frame in FRAMES:
            for detection in detector.update(spoilt(frame, field, value, zones)):
                place = detection.place
                assert 0 < place.range_m < 1.2 * MOST_DISTANCE_M
                assert np.isfinite(place.position_m).all()
                assert np.isfinite(place.covariance).all()
                assert place.range_stddev_m >= 0
        if method == 'joint' and field == 'distance' and value <= 0:
            assert detector.counts.impossible > 0


def test_noise_of_all_bits_ends_nothing() -> None:
    """Thousands of frames of random bytes."""
    rng = np.random.default_rng(5)
    for method in METHODS:
        detector = create_detector(method, FRAMES[0].grid)
        with np.errstate(all='ignore'):
            for number in range(1500):
                noise = rng.integers(0, 256, (3, 64), dtype=np.uint8).view(np.float32)
                detector.update(
                    replace(
                        FRAMES[0],
                        stamp_ns=int(rng.integers(0, 2**62))
                        if number % 50 == 0
                        else number * 10**7,
                        distance=noise[0],
                        signal=noise[1],
                        ambient=noise[2],
                        status=rng.integers(0, 256, 16, dtype=np.uint8),
                    )
                )
