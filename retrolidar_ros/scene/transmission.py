# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What share of the light a marker lets through during an exposure."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene.description import Marker, Response
from retrolidar_ros.sensor.frame import Floats

_AT_ONCE = Response(dark_s=0.0, bright_s=0.0)


def exposure_edges(middle_s: Floats, exposure_s: float) -> Floats:
    """Return begin and end of exposures about times of shape (n,) [s], shape (n, 2)."""
    return middle_s[:, None] + exposure_s * np.array([-0.5, 0.5])


def transmitted(begin_s: Floats, levels: Floats, response: Response, edges_s: Floats) -> Floats:
    """Return the mean transmission of liquid crystals in exposures, 0 to 1, shape (n, ...).

    Bits begin at ascending times, shape (bits,) [s], and have levels of shape (bits, ...), 1 if
    bright and 0 if dark; it is bright before the first, and the last lasts. A bit lasts many time
    constants of the response, so each relaxes from the level of the one before. Begin and end of
    the exposures are of shape (n, 2) [s].
    """
    axes = tuple(range(1, levels.ndim))
    before = np.concatenate([np.ones_like(levels[:1]), levels[:-1]])
    lasting_s = np.expand_dims(np.diff(begin_s), axes)
    whole = response.integral(before[:-1], levels[:-1], lasting_s)
    passed = np.concatenate([np.zeros_like(levels[:1]), np.cumsum(whole, axis=0)])
    integral = []
    for times_s in edges_s.T:
        bit = np.maximum(np.searchsorted(begin_s, times_s, side='right') - 1, 0)
        since = np.expand_dims(times_s - begin_s[bit], axes)
        within = response.integral(before[bit], levels[bit], np.maximum(since, 0.0))
        integral.append(np.where(since < 0, since, passed[bit] + within))
    share: Floats = (integral[1] - integral[0]) / np.expand_dims(np.diff(edges_s)[:, 0], axes)
    return share


class Transmission(NamedTuple):
    """What a marker sends, and how its liquid crystal follows."""

    bits: NDArray[np.uint8]  # of a packet and the gap behind it, 1 = dark, shape (n,)
    bit_s: float
    start_s: float  # when the first packet begins; it is bright before
    response: Response
    packets: float = math.inf  # how many it sends, before it stays bright

    @classmethod
    def of(cls, marker: Marker) -> Transmission:
        """Return that of a marker of a scene."""
        return cls(
            np.concatenate([packet(marker.id), np.zeros(marker.gap_bits, dtype=np.uint8)]),
            marker.bit_period_s * (1 + marker.clock_error),
            marker.start_s,
            marker.response or _AT_ONCE,
            math.inf if marker.packets is None else marker.packets,
        )

    def mean(self, edges_s: Floats) -> Floats:
        """Return the mean transmission, 0 to 1, of exposures, whose edges [s] are (n, 2)."""
        if not len(edges_s):  # all frames of a block are lost
            return np.zeros(0)
        sent = self.packets * len(self.bits)
        span = np.floor((np.array([edges_s.min(), edges_s.max()]) - self.start_s) / self.bit_s)
        # From the bit before, as this is what the first one relaxes from.
        first, last = np.clip(span - [1, 0], 0, sent).astype(np.int64)
        index = np.arange(first, last + 1)
        levels = np.where(index < sent, 1.0 - self.bits[index % len(self.bits)], 1.0)
        return transmitted(self.start_s + self.bit_s * index, levels, self.response, edges_s)


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
