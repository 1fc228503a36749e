# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 3 of the paper's method: from samples to bits, and their fit to the packet."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.paper.preamble import SAMPLES_PER_BIT
from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.sensor.frame import Floats

PACKET_SAMPLES = SAMPLES_PER_BIT * PACKET_BITS
# Lower bound of a residual: the quantisation noise of the sensor [kcps/SPAD].
_RESOLUTION_STDDEV = 1 / 2048 / np.sqrt(12)


def threshold_bits(signal: Floats, d: Floats, c: Floats) -> NDArray[np.uint8]:
    """Decide the bits of packets by the nearer level: d for 0, d + c for 1 (paper §3.5).

    The paper decides by sample and does not say how two samples make a bit; here their mean
    is compared.

    Parameters
    ----------
    signal : array, shape (62, packets)
        [kcps/SPAD]
    d, c : array, shape (packets,)
        DC offset and channel coefficient [kcps/SPAD].

    Returns
    -------
    array of uint8, shape (packets, 31)
    """
    level = signal.reshape(PACKET_BITS, SAMPLES_PER_BIT, -1).mean(axis=1)
    bits: NDArray[np.uint8] = (np.abs(level - d) > np.abs(level - (d + c))).astype(np.uint8)
    return bits.T


class PacketFit(NamedTuple):
    """Fit of samples to the packets that were read, each field of shape (packets,)."""

    amplitude: Floats
    """Bright minus dark [kcps/SPAD]."""
    score: Floats
    """Normalised correlation, -1 to 1."""
    snr_db: Floats
    """20 log10 of amplitude over the residual's standard deviation [dB]."""


def fit_packets(signal: Floats, ids: NDArray[np.int64]) -> PacketFit:
    """Fit the sent packets, with free gain and offset, to the samples of each.

    Parameters
    ----------
    signal : array, shape (62, packets)
        [kcps/SPAD]
    ids : array of int, shape (packets,)
        The IDs that were read.
    """
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
