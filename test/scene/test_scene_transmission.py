# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import numpy as np
import pytest

from retrolidar_ros.marker.code import packet
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.transmission import Transmission, exposure_edges
from retrolidar_ros.sensor.frame import Floats

RESPONSE = Response(dark_s=0.5e-3, bright_s=3.5e-3)
SHARP = Marker(id=2061, position_m=(0, 0, 1), name='m')
MARKER = replace(SHARP, response=RESPONSE)
BIT_S = 0.042
ENDS_DARK = next(identity for identity in range(1, 4095) if packet(identity)[-1])


def mean(marker: Marker, middle_s: Floats, exposure_s: float) -> Floats:
    return Transmission.of(marker).mean(exposure_edges(middle_s, exposure_s))


def relaxed(marker: Marker, until_s: float, step_s: float) -> tuple[Floats, Floats]:
    """Step a first-order crystal through time; return times and its transmission, both (n,)."""
    bits = np.array([*packet(marker.id), *[0] * marker.gap_bits])
    response = marker.response or Response(dark_s=1e-9, bright_s=1e-9)
    # An exponential runs from 10 to 90 % in τ (ln 10 - ln 10/9).
    darker = 1 - math.exp(-step_s * math.log(9) / response.dark_s)
    brighter = 1 - math.exp(-step_s * math.log(9) / response.bright_s)
    times = np.arange(0, until_s, step_s)
    within = times + step_s / 2 - marker.start_s
    sent = np.floor(within / (marker.bit_period_s * (1 + marker.clock_error))).astype(int)
    silent = (sent < 0) | (sent >= (marker.packets or 10**9) * len(bits))
    goals = np.where(silent, 1.0, 1.0 - bits[sent % len(bits)])
    levels = np.empty_like(times)
    level = 1.0
    for index, goal in enumerate(goals.tolist()):
        levels[index] = level
        level += (goal - level) * (darker if goal < level else brighter)
    return times, levels


MARKERS = [
    MARKER,
    SHARP,
    replace(MARKER, start_s=0.3),
    replace(MARKER, start_s=0.25, packets=1),
    replace(MARKER, packets=2, gap_bits=3),
    replace(MARKER, id=2730, bit_period_s=0.02, gap_bits=1),
    replace(MARKER, id=0, clock_error=-0.05, gap_bits=40),
    replace(MARKER, id=4095, clock_error=0.05),
    replace(MARKER, bit_period_s=0.0071),
    replace(MARKER, id=ENDS_DARK, packets=1),  # its last bit fades out
]


@pytest.mark.parametrize('marker', MARKERS)
def test_light_is_that_of_a_crystal_stepped_through_time(marker: Marker) -> None:
    step_s = 5e-5
    times, levels = relaxed(marker, 3.0, step_s)
    integral = np.cumsum((levels[1:] + levels[:-1]) / 2 * step_s)
    slices_s = np.column_stack([times[:-1], times[1:]])
    computed = np.cumsum(Transmission.of(marker).mean(slices_s) * step_s)
    # In bits of two response times the crystal does not quite settle, which is neglected.
    error_s = 1e-4 if marker.bit_period_s > 0.01 else 1e-3
    assert np.abs(computed - integral).max() < error_s
