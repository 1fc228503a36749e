# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The newest bits of one zone, before any detection."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.blinking_zones import Samples
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Floats

# Alignments of bits that are tried: end of the last bit, and clock error.
_PHASES = np.arange(8) / 8
_CLOCKS = 1 + 0.007 * np.arange(-4, 5)
# Minimum number of valid samples of a bit, of two; with fewer it is erased.
_MIN_VALID = 0.5


class NewestBits(NamedTuple):
    """The last 31 bits that a zone saw, oldest first."""

    signal: Floats  # mean of each bit [kcps/SPAD], NaN where it was erased, shape (31,)
    dark: float  # mean of the darker bits [kcps/SPAD]
    bright: float  # mean of the brighter bits [kcps/SPAD]

    @property
    def erased(self) -> NDArray[np.bool_]:
        """Which bits are erased, shape (31,)."""
        return np.isnan(self.signal)

    @property
    def hard(self) -> NDArray[np.bool_]:
        """Whether each bit is nearer to dark: a bit 1; shape (31,)."""
        return self.signal < (self.bright + self.dark) / 2


def newest_bits(samples: Samples, zone: int, bit_period_s: float) -> NewestBits | None:
    """Return the last bits, of about `bit_period_s`, of a zone, cut where they vary most.

    None if they are too few, or all alike.
    """
    bit_s, phase = (grid.ravel() for grid in np.meshgrid(bit_period_s * _CLOCKS, _PHASES))
    # Shape (alignments, bits + 1).
    edge_s = samples.end_s[-1] - bit_s[:, None] * (phase[:, None] + np.arange(PACKET_BITS, -1, -1))
    # Share of each exposure in each bit, shape (alignments, bits, samples).
    begin = np.maximum(samples.begin_s, edge_s[:, :-1, None])
    end = np.minimum(samples.end_s, edge_s[:, 1:, None])
    period_s = samples.end_s[0] - samples.begin_s[0]
    share = np.maximum(end - begin, 0.0) / period_s * samples.valid[:, zone]
    count = share.sum(axis=-1)
    means = np.full(count.shape, np.nan)
    np.divide(share @ samples.signal[:, zone], count, out=means, where=count > _MIN_VALID)
    known = ~np.isnan(means)
    number = np.maximum(known.sum(axis=-1), 1)
    change = means - (np.nansum(means, axis=-1) / number)[:, None]
    best = int((np.nansum(change**2, axis=-1) / number).argmax())
    signal, known = means[best], known[best]
    if np.count_nonzero(known) < PACKET_BITS // 2 or not np.ptp(signal[known]):
        return None
    is_bright = signal[known] > (signal[known].min() + signal[known].max()) / 2
    levels = (float(signal[known][one].mean()) for one in (~is_bright, is_bright))
    return NewestBits(signal, *levels)
