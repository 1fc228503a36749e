# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of the paper's method (§3.5): silent level, fit of the preamble, bits, fit of packets."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.marker.code import PACKET_BITS, PREAMBLE, packet
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.model import VL53L8CX

SAMPLES_PER_BIT = 2  # the marker sends at half the frame rate (paper §3.4)
PREAMBLE_SAMPLES = SAMPLES_PER_BIT * len(PREAMBLE)
_TEMPLATE: Floats = np.repeat(PREAMBLE, SAMPLES_PER_BIT).astype(np.float64)  # the paper's p
PACKET_SAMPLES = SAMPLES_PER_BIT * PACKET_BITS
# Lower bound of a residual: the quantisation noise of the sensor [kcps/SPAD].
_RESOLUTION_STDDEV = VL53L8CX.signal_step / np.sqrt(12)
# Autocorrelation at one sample above which a zone transmits. A marker holds every bit for two
# samples, so that of a packet with any usable ID is at least 0.145; that of white noise is 0, and
# its estimate from 62 samples deviates by 0.13, so one silent window in six or so is taken for a
# transmitting one and d comes out 0.8 standard deviations too high.
_TRANSMITTING = 0.14


def silent_level(signal: Floats) -> Floats:
    """Estimate the signal of zones while no marker in them transmits, (samples, zones) to (zones,).

    The paper takes the mean of the samples before a marker wakes (§3.5). A marker that repeats
    its packet without a pause has no such time, but a silent marker is bright: there the
    samples nearer to the brightest quarter than to the darkest are averaged. At least a third of
    the bits of any packet are bright and a third are dark, the reserved IDs excepted.
    """
    mean: Floats = signal.mean(axis=0)
    centred = signal - mean
    power = np.einsum('tz,tz->z', centred, centred)
    lagged = np.einsum('tz,tz->z', centred[1:], centred[:-1])
    transmitting = np.flatnonzero(lagged > _TRANSMITTING * power)
    if len(transmitting):
        mean[transmitting] = _bright_level(signal[:, transmitting])
    return mean


def _bright_level(signal: Floats) -> Floats:
    """Return the mean of the samples on the bright side of the middle between the extremes."""
    quarter = len(signal) // 4
    ordered = np.sort(signal, axis=0)
    middle = (ordered[:quarter].mean(axis=0) + ordered[-quarter:].mean(axis=0)) / 2
    bright = signal >= middle
    level: Floats = (signal * bright).sum(axis=0) / bright.sum(axis=0)
    return level


class PreambleFit(NamedTuple):
    """Least-squares fits of the preamble, each field of shape (zones,)."""

    c: Floats  # channel coefficient: what a dark bit adds to the signal, less than 0 [kcps/SPAD]
    e: Floats  # root of the summed squared error [kcps/SPAD]
    likelihood: Floats


def fit_preamble(signal: Floats, d: Floats) -> PreambleFit:
    """Fit the preamble to samples and return the likelihood that it begins with the first one.

    The equations of paper §3.5, unnumbered there, in their order::

        c = (pᵀp)⁻¹ pᵀs        e = sqrt(Σ (s_i - c·p_i)²)        l = c² / ((e + 1)·d)

    with e + 1 instead of e by the paper's footnote 1. The paper leaves open whether s holds the
    DC offset; with 0 and 1 in p only s = I - d makes the c that its bit decision I = d + c asks
    for. I is of shape (14, zones) and d, the signal while nothing is sent, of (zones,) [kcps/SPAD];
    where that is 0 nothing is received, and the likelihood is 0.
    """
    s = signal - d
    c = _TEMPLATE @ s / (_TEMPLATE @ _TEMPLATE)
    residual = s - _TEMPLATE[:, None] * c
    e = np.sqrt(np.einsum('tz,tz->z', residual, residual))
    likelihood = np.divide(c * c, (e + 1) * d, out=np.zeros_like(d), where=d > 0)
    return PreambleFit(c, e, likelihood)


def threshold_bits(signal: Floats, d: Floats, c: Floats) -> NDArray[np.uint8]:
    """Decide the bits of packets by the nearer level: d for 0, d + c for 1 (paper §3.5).

    The paper does not say how two samples make a bit; here their mean is compared. Signals (62,
    packets) and levels (packets,) give bits of shape (packets, 31).
    """
    level = signal.reshape(PACKET_BITS, SAMPLES_PER_BIT, -1).mean(axis=1)
    bits: NDArray[np.uint8] = (np.abs(level - d) > np.abs(level - (d + c))).astype(np.uint8)
    return bits.T


class PacketFit(NamedTuple):
    """Fit of samples to the packets that were read, each field of shape (packets,)."""

    amplitude: Floats  # bright minus dark [kcps/SPAD]
    score: Floats  # normalised correlation, -1 to 1
    snr_db: Floats  # 20 log10 of amplitude over the residual's standard deviation [dB]


def fit_packets(signal: Floats, ids: NDArray[np.int64]) -> PacketFit:
    """Fit sent packets, with free gain and offset, to the samples of each, shape (62, packets)."""
    bright = np.repeat(1.0 - packet(ids), SAMPLES_PER_BIT, axis=-1).T
    bright = bright - bright.mean(axis=0)
    centred = signal - signal.mean(axis=0)
    bright_energy = (bright * bright).sum(axis=0)
    amplitude = (bright * centred).sum(axis=0) / bright_energy
    energy = (centred * centred).sum(axis=0)
    explained = amplitude * amplitude * bright_energy
    variance = np.maximum(energy - explained, 0) / (PACKET_SAMPLES - 2)
    stddev = np.maximum(np.sqrt(variance), _RESOLUTION_STDDEV)
    score = np.sign(amplitude) * np.sqrt(
        np.divide(explained, energy, out=np.zeros_like(energy), where=energy > 0)
    )
    snr_db = 20 * np.log10(np.maximum(np.abs(amplitude), _RESOLUTION_STDDEV) / stddev)
    return PacketFit(amplitude, score, snr_db)
