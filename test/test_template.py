# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from retrolidar_ros.code import BIT_PERIOD_S, IDS, packet
from retrolidar_ros.detector.template import packet_light
from retrolidar_ros.frame import Floats
from retrolidar_ros.liquid_crystal import Response
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.transmission import Transmission

EXPOSURE_S = 0.021
MIDDLE_S: Floats = (np.arange(200) + 0.5) * EXPOSURE_S
BEGIN_S, END_S = MIDDLE_S - EXPOSURE_S / 2, MIDDLE_S + EXPOSURE_S / 2
PACKETS = 30


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize('repeats', [False, True])
def test_a_template_is_what_the_simulation_shows(repeats: bool, rng: np.random.Generator) -> None:
    ids = rng.integers(0, IDS, PACKETS)
    # Whoever repeats without end has begun before the first exposure.
    start_s = rng.uniform(-9, -0.1, PACKETS) if repeats else rng.uniform(-0.7, 4.0, PACKETS)
    clock_error = rng.uniform(-0.01, 0.01, PACKETS)
    light = packet_light(
        packet(ids),
        start_s,
        BIT_PERIOD_S * (1 + clock_error),
        np.full(PACKETS, repeats),
        BEGIN_S,
        END_S,
    )
    for row in range(PACKETS):
        marker = Marker(
            id=int(ids[row]),
            position_m=(0, 0, 1),
            name='marker',
            start_s=float(start_s[row]),
            clock_error=float(clock_error[row]),
            packets=None if repeats else 1,
            response=Response(0.0005, 0.0035),
        )
        expected = Transmission(marker).mean(MIDDLE_S, EXPOSURE_S)
        assert light.mean[row] == pytest.approx(expected, abs=1e-9)


def test_a_repeating_template_may_start_anywhere(rng: np.random.Generator) -> None:
    bits, bit_s = packet(np.array([700, 2073])), np.full(2, 0.0417)
    repeats = np.ones(2, dtype=bool)
    start_s = rng.uniform(0, 1, 2)
    lights = [
        packet_light(bits, start_s + 31 * bit_s * late, bit_s, repeats, BEGIN_S, END_S).mean
        for late in (-2, 0, 5)
    ]
    assert lights[1] == pytest.approx(lights[0], abs=1e-9)
    assert lights[2] == pytest.approx(lights[0], abs=1e-9)


@pytest.mark.parametrize('repeats', [False, True])
@pytest.mark.parametrize('by', ['start', 'bit'])
def test_derivatives_are_differences(repeats: bool, by: str, rng: np.random.Generator) -> None:
    bits = packet(rng.integers(1, IDS - 1, PACKETS))
    start_s = rng.uniform(0, 2, PACKETS)
    bit_s = BIT_PERIOD_S * (1 + rng.uniform(-0.01, 0.01, PACKETS))
    repeating = np.full(PACKETS, repeats)
    step_s = 1e-9

    def mean(late_s: float) -> Floats:
        starts_s = start_s + (late_s if by == 'start' else 0.0)
        periods_s = bit_s + (late_s if by == 'bit' else 0.0)
        return packet_light(bits, starts_s, periods_s, repeating, BEGIN_S, END_S).mean

    light = packet_light(bits, start_s, bit_s, repeating, BEGIN_S, END_S)
    derivative = light.per_start if by == 'start' else light.per_bit
    difference = (mean(step_s) - mean(-step_s)) / (2 * step_s)
    assert np.abs(derivative).max() > 1 / EXPOSURE_S * 0.9
    error = np.abs(derivative - difference) / np.abs(derivative).max()
    # That by the bit period lets the liquid crystal's response stretch along with the bits.
    assert error.max() < (1e-5 if by == 'start' else 3e-3)
