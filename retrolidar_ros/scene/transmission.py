# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What share of the light a marker lets through during an exposure."""

from __future__ import annotations

import math

import numpy as np

from retrolidar_ros.marker.code import packet
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene.description import Marker, Occlusion
from retrolidar_ros.sensor.frame import Floats

_AT_ONCE = Response(dark_s=0.0, bright_s=0.0)


class Transmission:
    """The liquid crystal of one marker as the integral of its transmission over time.

    A bit lasts many time constants, so each bit relaxes from the level of the bit before it;
    with that, the integral has a closed form, and an exposure is a difference of two values.
    """

    def __init__(self, marker: Marker) -> None:
        """Tabulate one cycle of packet and gap."""
        self._bit_s = marker.bit_period_s * (1 + marker.clock_error)
        self._start_s = marker.start_s
        bits = np.concatenate([packet(marker.id), np.zeros(marker.gap_bits, dtype=np.uint8)])
        self._bright = 1.0 - bits
        self._before = np.roll(self._bright, 1)
        self._response = marker.response or _AT_ONCE
        self._bits_sent = math.inf if marker.packets is None else marker.packets * len(bits)
        whole_bits = self._response.integral(
            self._before, self._bright, np.full(len(bits), self._bit_s)
        )
        self._elapsed = np.concatenate([[0.0], np.cumsum(whole_bits)])
        # The very first bit follows the bright state of a silent marker.
        first = self._response.integral(np.ones(1), self._bright[:1], np.full(1, self._bit_s))
        self._first_excess = float(first[0] - whole_bits[0])

    def integral(self, time_s: Floats) -> Floats:
        """Return the integral [s] of the transmission from the first packet's start to each time.

        It is negative before the start.
        """
        since = time_s - self._start_s
        bits = np.clip(np.floor(since / self._bit_s), 0, self._bits_sent)
        cycles, index = np.divmod(bits, len(self._bright))
        index = index.astype(np.intp)
        ended = bits == self._bits_sent
        level = np.where(ended, 1.0, self._bright[index])
        before = np.where(bits == 0, 1.0, self._before[index])
        sent = cycles * self._elapsed[-1] + self._elapsed[index]
        sent = sent + np.where(bits > 0, self._first_excess, 0.0)
        within = self._response.integral(before, level, np.maximum(since - bits * self._bit_s, 0.0))
        return np.where(since < 0, since, sent + within)

    def mean(self, middle_s: Floats, exposure_s: float) -> Floats:
        """Return the mean transmission, 0 to 1, of exposures about the given times [s]."""
        half = exposure_s / 2
        passed: Floats = self.integral(middle_s + half) - self.integral(middle_s - half)
        return passed / exposure_s


def recurring_share(
    every_s: float, lasting_s: float, middle_s: Floats, exposure_s: float
) -> Floats:
    """Return the share of each exposure, 0 to 1, in which what recurs from time zero on lasts."""

    def lasted_until(time_s: Floats) -> Floats:
        times, phase = np.divmod(time_s, every_s)
        lasted: Floats = times * lasting_s + np.minimum(phase, lasting_s)
        return lasted

    half = exposure_s / 2
    lasted: Floats = lasted_until(middle_s + half) - lasted_until(middle_s - half)
    return lasted / exposure_s


def visible_share(occlusion: Occlusion, middle_s: Floats, exposure_s: float) -> Floats:
    """Return the share of each exposure, 0 to 1, in which the occlusion leaves a free sight."""
    return 1 - recurring_share(occlusion.every_s, occlusion.lasting_s, middle_s, exposure_s)
