# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How much every zone blinks, and the newest bits of one, before anything is decided of them."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, packet
from retrolidar_ros.detector.evidence import NoiseLaw
from retrolidar_ros.detector.fold import FoldSearch
from retrolidar_ros.detector.search import Demand
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.words import WordBank
from retrolidar_ros.frame import Floats

# Samples that must tell of a bit, of its two; of an erased one it is not known what it is.
_LEAST_TOLD = 0.5
# Rounds in which the level between dark and bright settles.
_ROUNDS = 5


def modulation_db(view: View, law: NoiseLaw) -> Floats:
    """Return by how much zones vary beyond noise, as the SNR of a marker that did so.

    Half of a marker's bits are dark, so an amplitude of c makes a variance of c²/4. A hand that
    passes makes one, too.

    Parameters
    ----------
    view : View
    law : NoiseLaw
        Of the sensor.

    Returns
    -------
    array, shape (zones,)
        20 log10 of amplitude over the noise's standard deviation [dB]; -inf where there is
        nothing but noise.
    """
    told = np.maximum(view.weight.sum(axis=0), 1.0)
    deviation = (view.signal - view.mean) * view.weight
    noise = law.variance(view.mean)
    excess = np.maximum((deviation * deviation).sum(axis=0) / told - noise, 0.0)
    with np.errstate(divide='ignore'):
        decibels: Floats = 10 * np.log10(4 * excess / noise)
    return decibels


class NewestBits(NamedTuple):
    """The last 31 bits that a zone saw, oldest first, and the packet that is nearest to them."""

    signal: Floats
    """Mean of each bit [kcps/SPAD], NaN where it was erased, shape (31,)."""
    dark: float
    """Level of dark bits [kcps/SPAD]."""
    bright: float
    """Level of bright bits [kcps/SPAD]."""
    snr_db: float
    """Amplitude over the noise of a sample, by these levels and the noise law [dB]."""
    id: int
    """Whose packet, begun with any bit, explains them best."""
    correlation: float
    """With that packet, 0 to 1."""
    first: int
    """Which bit of that packet the oldest bit is, 0 to 30."""

    @property
    def erased(self) -> NDArray[np.bool_]:
        """Which bits are not known, shape (31,)."""
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
        """How many bits differ from those of the packet that is nearest."""
        nearest = np.roll(packet(self.id), -self.first) == 1
        return int(np.count_nonzero((self.hard != nearest) & ~self.erased))


class BitReader:
    """Cuts the newest samples of a zone into bits where the search for repeating packets does."""

    def __init__(self, bit_period_s: float) -> None:
        """Expect bits of about `bit_period_s` [s]."""
        self._search = FoldSearch(WordBank(), bit_period_s)

    def read(self, view: View, law: NoiseLaw) -> NewestBits | None:
        """Return the last bits of a view of one zone; None if they are too few, or all alike."""
        anything = Demand(0.0, law.variance(view.mean))
        found = self._search.folded(view, float(view.end_s[-1]), 1, anything)
        if found is None:
            return None
        begin_s, bit_s = float(found.begin_s[0]), float(found.bit_s[0])
        total, position = view.cumulated(begin_s + bit_s * np.arange(PACKET_BITS + 1))
        told = np.diff(total[:, 2] if total.shape[1] > 2 else position)
        known = told > _LEAST_TOLD
        signal = np.full(PACKET_BITS, np.nan)
        signal[known] = view.mean[0] + np.diff(total[:, 0])[known] / told[known]
        dark, bright = _levels(signal[known])
        if not bright > dark:
            return None
        noise = float(law.variance(np.asarray((dark + bright) / 2)))
        return NewestBits(
            signal=signal,
            dark=dark,
            bright=bright,
            snr_db=20 * math.log10((bright - dark) / math.sqrt(noise)),
            id=int(found.ids[0]),
            correlation=min(float(found.correlation[0]), 1.0),  # of coarse templates
            first=round((begin_s - float(found.start_s[0])) / bit_s) % PACKET_BITS,
        )


def _levels(signal: Floats) -> tuple[float, float]:
    """Return the means of the darker and of the brighter ones of signals (bits,)."""
    dark, bright = float(signal.min()), float(signal.max())
    for _ in range(_ROUNDS):
        is_bright = signal > (dark + bright) / 2
        if is_bright.all() or not is_bright.any():
            break
        dark, bright = float(signal[~is_bright].mean()), float(signal[is_bright].mean())
    return dark, bright
