# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Clocks of zones that blink."""

from dataclasses import replace

import numpy as np
import pytest

from retrolidar_ros.detector.blinking_zones import blinking_zones
from retrolidar_ros.scene import Simulation, parse_scene
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.noise import NoiseLaw


def recorded(period: str, bit: str, zones: str = '4x4') -> Recording:
    noise = {'floor': '4.6 (kcps/SPAD)^2', 'slope': '0.22 kcps/SPAD'}
    sensor = {'zones': zones, 'period': period, 'jitter': '1 ms', 'noise': noise}
    marker = {'id': 2816, 'position': ['0.13 m', '0.13 m', '1.2 m'], 'clock_error': '0.4 %'}
    wall = {'distance': '1.25 m', 'signal': '10 kcps/SPAD'}
    markers = [{**marker, 'bit_period': bit}]
    scene = {'seed': 5, 'sensor': sensor, 'markers': markers, 'surfaces': [wall]}
    return Simulation(parse_scene(scene)).run(20.0)


@pytest.mark.parametrize(
    ('period', 'bit', 'zones'),
    [('21 ms', '42 ms', '4x4'), ('33.3 ms', '100 ms', '4x4'), ('66.7 ms', '300 ms', '8x8')],
)
def test_an_unknown_bit_period_is_found(period: str, bit: str, zones: str) -> None:
    recording = recorded(period, bit, zones)
    strongest = blinking_zones(recording, NoiseLaw())[0]
    assert strongest.periods[0].bit_period_s == pytest.approx(
        float(bit.split()[0]) * 1.004e-3, rel=0.02
    )
    assert strongest.is_clocked


@pytest.mark.parametrize('steps_s', [[0.0], [0.0, 0.0, 0.0, 0.1], [0.02] * 100 + [-2.0], [-0.02]])
def test_stamps_that_do_not_go_on_have_no_bits(steps_s: list[float]) -> None:
    """As of a simulated clock that stands or ticks slowly, and of a replay that begins again."""
    recording = recorded('21 ms', '42 ms')
    steps_ns = np.rint(1e9 * np.resize(steps_s, len(recording) - 1)).astype(np.int64)
    odd = replace(recording, stamp_ns=10**12 + np.concatenate([[0], np.cumsum(steps_ns)]))
    with np.errstate(all='raise'):
        assert all(not zone.periods for zone in blinking_zones(odd, NoiseLaw()))
