# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 1b of the paper's method: the DC offset d, the signal while a marker is silent."""

from __future__ import annotations

import numpy as np

from retrolidar_ros.sensor.frame import Floats

# Autocorrelation at one sample above which a zone transmits. A marker holds every bit for two
# samples, so that of a packet with any usable ID is at least 0.145; that of white noise is 0, and
# its estimate from 62 samples deviates by 0.13, so one silent window in six or so is taken for a
# transmitting one and d comes out 0.8 standard deviations too high.
_TRANSMITTING = 0.14


def silent_level(signal: Floats) -> Floats:
    """Estimate the signal of a zone while no marker in it transmits.

    The paper takes the mean of the samples before a marker wakes (§3.5). A marker that repeats
    its packet without a pause has no such time, but a silent marker is bright: there the
    samples nearer to the brightest quarter than to the darkest are averaged. At least a third of
    the bits of any packet are bright and a third are dark, the reserved IDs excepted.

    Parameters
    ----------
    signal : array, shape (samples, zones)
        At least four samples [kcps/SPAD].

    Returns
    -------
    array, shape (zones,)
        [kcps/SPAD]
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
