# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bit periods that nobody told."""

from __future__ import annotations

import numpy as np
import pytest

from retrolidar_ros.detector.blinking_zones import blinking_zones, unread
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.scene import Simulation, parse_scene
from retrolidar_ros.sensor.frame import Recording, ZoneGrid


def recorded(period: str, bit: str, zones: str = '4x4', seconds: float = 20.0) -> Recording:
    scene = parse_scene(
        {
            'seed': 5,
            'sensor': {
                'zones': zones,
                'period': period,
                'jitter': '1 ms',
                'noise': {'floor': '4.6 (kcps/SPAD)^2', 'slope': '0.22 kcps/SPAD'},
            },
            'markers': [
                {
                    'id': 2816,
                    'position': ['0.13 m', '0.13 m', '1.2 m'],
                    'bit_period': bit,
                    'clock_error': '0.4 %',
                }
            ],
            'surfaces': [{'distance': '1.25 m', 'signal': '10 kcps/SPAD'}],
        }
    )
    return Simulation(scene).run(seconds)


@pytest.mark.parametrize(
    ('period', 'bit', 'zones'),
    [('21 ms', '42 ms', '4x4'), ('33.3 ms', '100 ms', '4x4'), ('66.7 ms', '300 ms', '8x8')],
)
def test_bit_period_is_found_without_being_told(period: str, bit: str, zones: str) -> None:
    recording = recorded(period, bit, zones)
    strongest = blinking_zones(recording, NoiseLaw())[0]
    assert strongest.bit_period_s == pytest.approx(float(bit.split()[0]) * 1.004e-3, rel=0.02)
    assert strongest.periods[0].strength > 10


def test_noise_does_not_blink() -> None:
    rng = np.random.default_rng(3)
    still = recorded('21 ms', '42 ms')
    grid = ZoneGrid()
    signal = 30 + NoiseLaw().variance(np.array(30.0)) ** 0.5 * rng.standard_normal((900, 16))
    noise = Recording(
        stamp_ns=still.stamp_ns[:900],
        sequence=still.sequence[:900],
        sensor_time_us=still.sensor_time_us[:900],
        grid=grid,
        distance=np.ones((900, 16), dtype=np.float32),
        signal=signal.astype(np.float32),
        ambient=np.zeros((900, 16), dtype=np.float32),
        status=np.full((900, 16), 5, dtype=np.uint8),
    )
    assert blinking_zones(noise, NoiseLaw()) == []


def test_every_mismatch_is_a_sentence_with_its_remedy() -> None:
    zones = blinking_zones(recorded('21 ms', '46 ms'), NoiseLaw())
    (slow, *_) = unread(zones, 0.021, 0.042)
    assert 'bits of 46.2 ms, not of 42.0 ms: set bit_period to 0.0462' in slow
    assert 'a frame comes every 66.7 ms' in unread(zones, 0.0667, 0.046)[0]
    assert 'no zone blinks' in unread([], 0.021, 0.042)[0]
    assert 'without a bit clock' in unread([zones[0]._replace(periods=())], 0.021, 0.042)[0]
    assert 'as expected' in unread(zones, 0.021, 0.046)[0]
    flat = zones[0]._replace(contrast=0.05)
    assert 'but by 5 % of its light only' in unread([flat], 0.021, 0.046)[0]
