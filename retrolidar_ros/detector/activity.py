# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which zones do more than make noise, so that the searches are spared the others."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.evidence import NoiseScale
from retrolidar_ros.detector.search import PACKET_SAMPLES
from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import Floats

# What 62 samples must deviate more than the noise law, to be looked at.
_LEAST_VARIANCE = 1.3
# Standard deviations by which a zone must stand out of white noise over several packets.
_LEAST_REPETITION = 3.5


def modulated(
    samples: Samples, zones: NDArray[np.intp], frames: int, noise: NoiseScale
) -> NDArray[np.bool_]:
    """Return which zones deviate by more than noise in a packet's length.

    Parameters
    ----------
    samples : Samples
    zones : array of int, shape (zones,)
        Those in question.
    frames : int
        How many of the newest samples may each be the last of that length.
    noise : NoiseScale
        Of the sensor.

    Returns
    -------
    array of bool, shape (zones,)
    """
    recent = slice(max(0, len(samples.time_s) - PACKET_SAMPLES - frames + 1), None)
    weight, signal = samples.weight[recent, zones], samples.signal[recent, zones]
    if frames == 1:
        count = weight.sum(axis=0)
        total = signal.sum(axis=0)  # it is 0 where the weight is
        square = np.einsum('tz,tz->z', signal, signal)
    else:
        count, total, square = (
            _moving_sum(values, min(PACKET_SAMPLES, len(values)))
            for values in (weight, signal, signal * signal)
        )
    count = np.maximum(count, 1.0)
    mean = total / count
    variance = square / count - mean * mean
    deviating: NDArray[np.bool_] = variance > _LEAST_VARIANCE * noise.variance(mean)
    return deviating if frames == 1 else np.asarray(deviating.any(axis=0))


def may_repeat(samples: Samples, zones: NDArray[np.intp], noise: NoiseScale) -> NDArray[np.bool_]:
    """Return which zones are not just noise over the length of one packet or of several.

    The variance beyond the noise law, the likeness of neighbouring samples and, where there
    are several packets, of samples a packet apart all count, in standard deviations; but a
    law that promises too much noise counts nothing.

    Parameters
    ----------
    samples : Samples
    zones : array of int, shape (zones,)
        Those in question.
    noise : NoiseScale
        Of the sensor.

    Returns
    -------
    array of bool, shape (zones,)
    """
    signal = samples.signal[:, zones]
    count = len(signal)
    mean = signal.mean(axis=0)
    deviation = signal - mean
    power = np.maximum(np.einsum('tz,tz->z', deviation, deviation), 1e-9)
    lagged = np.einsum('tz,tz->z', deviation[1:], deviation[:-1])
    excess = (power / count / noise.variance(mean) - 1) * math.sqrt(count / 2)
    alike = lagged
    if count > 2 * PACKET_SAMPLES:
        # A sample more or less, for a clock that is off.
        apart = [
            np.einsum('tz,tz->z', deviation[lag:], deviation[:-lag])
            for lag in (PACKET_SAMPLES - 1, PACKET_SAMPLES, PACKET_SAMPLES + 1)
        ]
        alike = lagged + np.maximum(np.maximum(apart[0], apart[1]), apart[2])
    repeats: NDArray[np.bool_] = (
        np.maximum(excess, 0.0) + alike / power * math.sqrt(count) > _LEAST_REPETITION
    )
    return repeats


def _moving_sum(values: Floats, length: int) -> Floats:
    """Return the sums over `length` successive rows."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
    moving: Floats = total[length:] - total[:-length]
    return moving
