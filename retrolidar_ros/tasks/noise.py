# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The noise law of a sensor, from zones at rest.

Each zone is cut into blocks, so that a slow drift is no noise. A block gives a mean and a variance,
and the law is fitted to these by weighted least squares: the variance of a sample variance of
normal noise is 2·v²/(n - 1).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.sensor.model import NoiseLaw, Status

_BLOCK = 128  # frames
_MIN_SAMPLES = 48  # samples of a block
_MIN_SEEN = 0.6  # of the samples of a zone
_MAX_FAINT = 0.05  # of those of a block: without them the variance looks smaller
_SIGMAS = 3.0  # excess correlation of the samples of a zone that is not at rest
_ALL_MOVE = 0.3
_LAGS = (20, 320)  # frames after which a packet may come again
_MAX_SIMILAR = 6.0  # standard deviations, of steps of white noise
_ROUNDS = 30
_MIN_SURE = 0.35  # a slope that is less certain than this share of it is not reported
_MIN_FLOOR = 1e-3
_MIN_AMBIENT = 1.0  # by which the ambient light has to vary [kcps/SPAD]
_NORMAL_95 = 1.96


class Estimate(NamedTuple):
    """A value with its standard deviation."""

    value: float
    stddev: float

    def times(self, factor: float) -> Estimate:
        """Return it in another unit."""
        return Estimate(self.value * factor, self.stddev * abs(factor))

    def text(self, unit: str = '') -> str:
        """Return value ± half of the interval that holds the truth in 95 of 100 cases."""
        half = _NORMAL_95 * self.stddev
        digits = 6 if half <= 0 else min(max(1 - math.floor(math.log10(half)), 0), 6)
        return f'{self.value:.{digits}f} ± {half:.{digits}f}{" " if unit else ""}{unit}'


def weighted_mean(values: Floats, stddev: Floats) -> Estimate:
    """Return the weighted mean of values (n,), with its uncertainty raised if they disagree."""
    weight = stddev**-2
    mean = float(weight @ values / weight.sum())
    excess = float(weight @ (values - mean) ** 2) / max(len(values) - 1, 1)
    return Estimate(mean, float(np.sqrt(max(excess, 1.0) / weight.sum())))


class Block(NamedTuple):
    """Samples of one zone at rest."""

    signal: float  # mean [kcps/SPAD]
    ambient: float  # mean [kcps/SPAD]
    variance: float  # [(kcps/SPAD)²]
    samples: int


class NoiseFound(NamedTuple):
    """The noise law and its fit."""

    floor: Estimate  # [(kcps/SPAD)²]; with the ambient light's, where that did not vary
    slope: Estimate | None  # [kcps/SPAD]; None if the zones have too similar signals
    ambient: Estimate | None  # [kcps/SPAD]; None if the ambient light did not vary enough
    light: float  # mean ambient light [kcps/SPAD]
    zones: list[int]  # those at rest
    blocks: list[Block]

    @property
    def law(self) -> NoiseLaw:
        """The law for a detector; an unknown slope is that of the usual law, scaled."""
        ambient = self.ambient.value if self.ambient else 0.0
        if self.slope is not None:
            return NoiseLaw(max(self.floor.value, _MIN_FLOOR), self.slope.value, ambient)
        usual = NoiseLaw()
        signal = float(np.mean([block.signal for block in self.blocks]))
        scale = self.floor.value / float(usual.variance(np.asarray(signal)))
        return NoiseLaw(usual.floor * scale, usual.slope * scale, ambient)


def noise_of(recording: Recording) -> NoiseFound | None:
    """Return the noise of the zones at rest; None if there is none."""
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    signal = recording.signal.astype(np.float64)
    faint = (recording.status == Status.NO_TARGET) | (valid & (signal <= 0))
    # A marker without a target in dark bits is not at rest.
    zones = _at_rest(np.where(faint, 0.0, signal), valid | faint, valid & ~faint)
    blocks = []
    for zone in zones:
        for begin in range(0, len(recording) - _MIN_SAMPLES + 1, _BLOCK):
            rows = slice(begin, begin + _BLOCK)
            seen = (valid & ~faint)[rows, zone]
            samples = signal[rows, zone][seen]
            hidden = np.count_nonzero(faint[rows, zone])
            if len(samples) < _MIN_SAMPLES or hidden > _MAX_FAINT * (len(samples) + hidden):
                continue
            light = float(recording.ambient[rows, zone][seen].mean())
            variance = float(samples.var(ddof=1))
            blocks.append(Block(float(samples.mean()), light, variance, len(samples)))
    return _fitted(blocks, zones) if blocks else None


def _at_rest(signal: Floats, known: NDArray[np.bool_], seen: NDArray[np.bool_]) -> list[int]:
    """Return the zones at rest, by the correlation of their successive samples."""
    alike: dict[int, float] = {}
    enough = seen.sum(axis=0) >= max(_MIN_SAMPLES, _MIN_SEEN * len(signal))
    for zone in np.flatnonzero(enough).tolist():
        own = known[:, zone]
        change = np.where(own, signal[:, zone] - signal[own, zone].mean(), 0)
        if (power := float(change @ change)) > 0:
            alike[zone] = float(change[1:] @ change[:-1]) / power
    if not alike:
        return []
    values = np.array(list(alike.values()))
    chance = 1 / math.sqrt(len(signal))
    usual = float(np.quantile(values, 0.25)) + 0.67 * chance
    if usual > _ALL_MOVE:
        return []
    return [
        zone
        for zone, value in alike.items()
        if value < max(usual, 0.0) + _SIGMAS * chance
        and not _repeats(signal[:, zone], known[:, zone])
    ]


def _repeats(signal: Floats, known: NDArray[np.bool_]) -> bool:
    """Return whether a zone repeats: bits of one frame look like noise otherwise."""
    both = known[1:] & known[:-1]
    step = np.where(both, np.diff(signal), 0.0)
    size = 2 << len(step).bit_length()
    similar = np.fft.irfft(np.abs(np.fft.rfft(step, size)) ** 2, size)[: max(_LAGS)]
    energy = np.fft.irfft(np.abs(np.fft.rfft(both.astype(float), size)) ** 2, size)[: max(_LAGS)]
    score = similar / max(float(similar[0]), 1e-30) * energy[0] / np.sqrt(np.maximum(energy, 1))
    return float(score[min(_LAGS) :].max(initial=0.0)) > _MAX_SIMILAR


def _fitted(blocks: list[Block], zones: list[int]) -> NoiseFound:
    signal, ambient, variance, samples = np.array(blocks).T
    columns = [np.ones_like(signal), np.maximum(signal, 0.0)]
    if np.ptp(ambient) > _MIN_AMBIENT:
        columns.append(ambient)
    while True:
        values = _weighted(np.stack(columns, axis=-1), variance, samples - 1)
        if all(one.stddev < _MIN_SURE * values[1].value and one.value > 0 for one in values[1:]):
            break
        columns.pop()
    floor, *others = values
    slope, light = (*others, None, None)[:2]
    return NoiseFound(floor, slope, light, float(ambient.mean()), zones, blocks)


def _weighted(design: Floats, variance: Floats, freedom: Floats) -> list[Estimate]:
    """Return the coefficients of a law; a reduced chi-square above 1 raises their deviations."""
    expected = np.full_like(variance, variance.mean())
    for _ in range(_ROUNDS):
        weight = freedom / (2 * expected**2)
        covariance = np.linalg.pinv((design.T * weight) @ design)
        value = covariance @ (design.T @ (weight * variance))
        expected = np.maximum(design @ value, 1e-3 * variance.mean())
    chi2 = float(weight @ (variance - expected) ** 2) / max(len(variance) - len(value), 1)
    deviations = np.sqrt(np.diag(covariance) * max(chi2, 1.0))
    return [Estimate(*one) for one in zip(value.tolist(), deviations.tolist(), strict=True)]
