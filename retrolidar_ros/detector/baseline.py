# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 1b of the paper's method: the DC offset d, the signal while a marker is silent."""

from __future__ import annotations

import numpy as np

from retrolidar_ros.frame import Floats


def silent_level(signal: Floats) -> Floats:
    """Return the mean signal of zones that do not transmit (paper §3.5).

    Parameters
    ----------
    signal : array, shape (samples, zones)
        [kcps/SPAD]

    Returns
    -------
    array, shape (zones,)
    """
    mean: Floats = signal.mean(axis=0)
    return mean


def bright_level(signal: Floats) -> Floats:
    """Return the mean signal of the bright samples of zones that have not been silent.

    The paper knows d from before a marker wakes. A marker that repeats its packet without a
    pause has no such time, but a silent marker is bright: what is nearer to the brightest
    quarter of the samples than to the darkest tells d. At least a third of the bits of any
    packet are bright and a third are dark, the reserved IDs excepted.

    Parameters
    ----------
    signal : array, shape (samples, zones)
        At least four samples [kcps/SPAD].

    Returns
    -------
    array, shape (zones,)
    """
    quarter = len(signal) // 4
    ordered = np.sort(signal, axis=0)
    middle = (ordered[:quarter].mean(axis=0) + ordered[-quarter:].mean(axis=0)) / 2
    bright = signal >= middle
    mean: Floats = (signal * bright).sum(axis=0) / bright.sum(axis=0)
    return mean
