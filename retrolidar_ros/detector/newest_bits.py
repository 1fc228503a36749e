# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The newest bits of one zone, before any detection."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.blinking_zones import Samples
from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.noise import NoiseLaw

# Alignments of bits that are tried: end of the last bit, and clock error.
_PHASES = np.arange(8) / 8
_CLOCKS = 1 + 0.007 * np.arange(-4, 5)
# Minimum number of valid samples of a bit, of two; with fewer it is erased.
_MIN_VALID = 0.5


class NewestBits(NamedTuple):
    """The last 31 bits that a zone saw, oldest first, and the packet that is nearest to them."""

    signal: Floats
    """Mean of each bit [kcps/SPAD], NaN where it was erased, shape (31,)."""
    dark: float
    """Mean of the bits that are dark in that packet [kcps/SPAD]."""
    bright: float
    """Mean of those that are bright in it [kcps/SPAD]."""
    snr_db: float
    """Amplitude over the noise of a sample, by these levels and the noise law [dB]."""
    id: int
    """ID of the packet, begun with any bit, that correlates best with them."""
    correlation: float
    """With that packet, 0 to 1."""
    first: int
    """Index of the oldest bit in that packet, 0 to 30."""

    @property
    def erased(self) -> NDArray[np.bool_]:
        """Which bits are erased, shape (31,)."""
        return np.isnan(self.signal)

    @property
    def darkness(self) -> Floats:
        """Soft bits: 0 at the bright level and 1 at the dark one, shape (31,)."""
        darkness: Floats = (self.bright - self.signal) / (self.bright - self.dark)
        return darkness

    @property
    def hard(self) -> NDArray[np.bool_]:
        """Whether each bit is nearer to dark: a bit 1; shape (31,)."""
        return self.darkness > 0.5

    @property
    def differing(self) -> int:
        """How many bits differ from those of the nearest packet."""
        nearest = np.roll(packet(self.id), -self.first) == 1
        return int(np.count_nonzero((self.hard != nearest) & ~self.erased))


class BitReader:
    """Cuts the newest samples of a zone into bits, and finds the nearest packet."""

    def __init__(self, bit_period_s: float) -> None:
        """Expect bits of about `bit_period_s` [s]."""
        self._bit_s = bit_period_s
        self._light = 1.0 - packet(USABLE_IDS)

    def read(self, samples: Samples, zone: int, law: NoiseLaw) -> NewestBits | None:
        """Return the last bits of a zone; None if they are too few, or all alike."""
        signal = self._aligned(samples, zone)
        known = ~np.isnan(signal)
        if np.count_nonzero(known) < PACKET_BITS // 2 or not np.ptp(signal[known]):
            return None
        correlation = self._correlations(signal)
        first, nearest = np.unravel_index(correlation.argmax(), correlation.shape)
        is_bright = np.roll(self._light[nearest], -first) == 1
        dark = float(signal[known & ~is_bright].mean())
        bright = float(signal[known & is_bright].mean())
        noise = float(law.variance(np.asarray((dark + bright) / 2)))
        return NewestBits(
            signal=signal,
            dark=dark,
            bright=bright,
            snr_db=20 * math.log10((bright - dark) / math.sqrt(noise)),
            id=int(USABLE_IDS[nearest]),
            correlation=float(correlation.max()),
            first=int(first),
        )

    def _aligned(self, samples: Samples, zone: int) -> Floats:
        """Return the mean of each bit (31,), NaN of erased ones, cut where these vary most."""
        bit_s, phase = (grid.ravel() for grid in np.meshgrid(self._bit_s * _CLOCKS, _PHASES))
        # Shape (alignments, bits + 1).
        edge_s = samples.end_s[-1] - bit_s[:, None] * (
            phase[:, None] + np.arange(PACKET_BITS, -1, -1)
        )
        # Share of each exposure in each bit, shape (alignments, bits, samples).
        period_s = samples.end_s[0] - samples.begin_s[0]
        begin = np.maximum(samples.begin_s, edge_s[:, :-1, None])
        end = np.minimum(samples.end_s, edge_s[:, 1:, None])
        share = np.maximum(end - begin, 0.0) / period_s * samples.valid[:, zone]
        count = share.sum(axis=-1)
        total = share @ samples.signal[:, zone]
        signal = np.full(count.shape, np.nan)
        np.divide(total, count, out=signal, where=count > _MIN_VALID)
        known = ~np.isnan(signal)
        number = np.maximum(known.sum(axis=-1), 1)
        mean = np.nansum(signal, axis=-1) / number
        power = np.nansum((signal - mean[:, None]) ** 2, axis=-1) / number
        best: Floats = signal[power.argmax()]
        return best

    def _correlations(self, signal: Floats) -> Floats:
        """Return the correlation of bits with packets, (31, packets), by which bit is the first."""
        known = ~np.isnan(signal)
        change = np.where(known, signal - signal[known].mean(), 0.0)
        turned = np.stack([np.roll(change, first) for first in range(PACKET_BITS)])
        counted = np.stack([np.roll(known, first) for first in range(PACKET_BITS)])
        bright = counted @ self._light.T
        energy = bright - bright**2 / np.count_nonzero(known)
        power = np.sqrt(np.maximum(energy, 1e-9) * (change @ change))
        correlation: Floats = turned @ self._light.T / power
        return correlation
