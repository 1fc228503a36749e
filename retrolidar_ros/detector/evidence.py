# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How much correlation chance alone can make, and how much noise the sensor itself makes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import Floats

# Steps of the correlation, at which its distribution is tabulated.
_STEPS = 20000


@lru_cache(maxsize=256)
def correlation_threshold(samples: int, chance: float) -> float:
    """Return the correlation that white noise exceeds with a given chance.

    A template and white noise of N samples, both without their mean, correlate by more than τ
    with the chance ½·I(1 - τ²; (N - 2)/2, ½), I the regularised incomplete beta function: it is
    the angle between a fixed and a random direction in N - 1 dimensions.

    Parameters
    ----------
    samples : int
        N, at least 5.
    chance : float
        For one template; from ½ on the threshold is 0.
    """
    grid = np.arange(_STEPS) / _STEPS
    density = np.exp((samples - 4) / 2 * np.log1p(-grid * grid))
    tail = np.cumsum(density[::-1])[::-1]
    above = tail / (2 * tail[0])
    index = int(np.searchsorted(-above, -chance))
    return index / _STEPS


def nats(correlation: Floats, samples: Floats) -> Floats:
    """Return the logarithm of the likelihood ratio of a fit of gain to samples against none.

    The noise's variance is unknown, and is what each of the two leaves over.
    """
    explained = np.minimum(correlation * correlation, 1 - 1e-12)
    ratio: Floats = np.where(correlation > 0, -samples / 2 * np.log1p(-explained), 0.0)
    return ratio


def _gamma_tail(half_zones: int, value: float) -> float:
    """Return Q(k/2, x), the upper regularised incomplete gamma function, for k = half_zones."""
    if half_zones % 2:
        order, tail = 0.5, math.erfc(math.sqrt(value))
    else:
        order, tail = 1.0, math.exp(-value)
    while order < half_zones / 2:
        tail += math.exp(order * math.log(value) - value - math.lgamma(order + 1))
        order += 1
    return tail


@lru_cache(maxsize=1024)
def group_threshold(threshold_nats: float, zones: int) -> float:
    """Return what the likelihood ratios of several zones must sum up to [nats].

    Each zone has a gain of its own, so chance has as many chances: the sum is held against the
    chi-square distribution with a degree of freedom a zone (Wilks 1938), such that chance
    reaches it as often as one zone reaches `threshold_nats`. All gains have to be positive.
    """
    if zones == 1 or threshold_nats <= 0:
        return threshold_nats
    chance = _gamma_tail(1, threshold_nats) / 2
    low, high = threshold_nats, threshold_nats + 10.0 * zones
    for _ in range(40):
        middle = (low + high) / 2
        if _gamma_tail(zones, middle) / 2**zones > chance:
            low = middle
        else:
            high = middle
    return high


@dataclass(frozen=True)
class NoiseLaw:
    """Frame-to-frame variance of the signal S of a zone in ambient light A: floor + a·S + b·A.

    Photons of either kind arrive at random; b is taken to be a, as if both were counted in the
    same gate. A sensor that counts ambient light over a longer time has a smaller b.
    """

    floor: float = 4.6
    """[(kcps/SPAD)²]"""
    slope: float = 0.22
    """a [kcps/SPAD]"""
    ambient: float = 0.22
    """b [kcps/SPAD]"""

    def __post_init__(self) -> None:
        """Raise ValueError for a law that allows no noise."""
        if not (self.floor > 0 and self.slope >= 0 and self.ambient >= 0):
            raise ValueError(
                f'noise of floor {self.floor}, slope {self.slope}, ambient {self.ambient}: the '
                'floor must be positive and the others not negative'
            )

    def lit(self, ambient: float) -> NoiseLaw:
        """Return the law in ambient light [kcps/SPAD], whose noise is part of its floor."""
        return NoiseLaw(self.floor + self.ambient * ambient, self.slope, 0.0)

    def variance(self, signal: Floats) -> Floats:
        """Return the variance [(kcps/SPAD)²] at signals [kcps/SPAD] of any shape."""
        return self.floor + self.slope * np.maximum(signal, 0.0)


class NoiseScale:
    """How many times the variance of the law the sensor at hand really has.

    It is learnt from zones where nothing happens. These are told by their whiteness and not by
    their variance, which is what is asked for: a blinking marker, a hand or a drift all leave
    neighbouring samples alike.
    """

    # Autocorrelation at one sample, below which 62 samples pass for white: 0 ± 0.13.
    _WHITE = 0.15
    _LEAST_ZONES = 3
    _LEAST, _MOST = 0.25, 4.0
    # Share of the newest estimate. One takes a packet's time; so the scale settles in ten seconds.
    _NEWEST = 0.15

    def __init__(self, law: NoiseLaw) -> None:
        """Start from the law as it is."""
        self.law = law
        self.value = 1.0

    def variance(self, signal: Floats) -> Floats:
        """Return the variance [(kcps/SPAD)²] at signals [kcps/SPAD] of any shape."""
        return self.value * self.law.variance(signal)

    def learn(self, samples: Samples) -> None:
        """Take in a packet's length of samples of all zones."""
        signal = samples.signal
        mean = signal.mean(axis=0)
        deviation = signal - mean
        power = np.einsum('tz,tz->z', deviation, deviation)
        lagged = np.einsum('tz,tz->z', deviation[1:], deviation[:-1])
        white = (lagged < self._WHITE * power) & (power > 0) & samples.weight.all(axis=0)
        if np.count_nonzero(white) < self._LEAST_ZONES:
            return
        # What a weak marker adds is alike in the two samples of a bit, and cancels here.
        variance = (power - 2 * lagged)[white] / (len(signal) - 1)
        scales = np.sort(variance / self.law.variance(mean[white]))
        scale = float(scales[len(scales) // 2])
        scale = min(max(scale, self._LEAST), self._MOST)
        self.value += self._NEWEST * (scale - self.value)
