# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 2 of the paper's method: how likely each sample is the start of a preamble."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from retrolidar_ros.marker.code import PREAMBLE
from retrolidar_ros.sensor.frame import Floats

SAMPLES_PER_BIT = 2  # the marker sends at half the frame rate (paper §3.4)
PREAMBLE_SAMPLES = SAMPLES_PER_BIT * len(PREAMBLE)
_TEMPLATE: Floats = np.repeat(PREAMBLE, SAMPLES_PER_BIT).astype(np.float64)
"""The paper's p."""


class PreambleFit(NamedTuple):
    """Least-squares fits of the preamble, each field of shape (zones,)."""

    c: Floats
    """Channel coefficient: what a dark bit adds to the signal, less than 0 [kcps/SPAD]."""
    e: Floats
    """Root of the summed squared error [kcps/SPAD]."""
    likelihood: Floats


def fit_preamble(signal: Floats, d: Floats) -> PreambleFit:
    """Fit the preamble to samples and return the likelihood that it begins with the first one.

    The equations of paper §3.5, unnumbered there, in their order::

        c = (pᵀp)⁻¹ pᵀs        e = sqrt(Σ (s_i - c·p_i)²)        l = c² / ((e + 1)·d)

    with e + 1 instead of e by the paper's footnote 1. The paper leaves open whether s holds the
    DC offset; with 0 and 1 in p only s = I - d makes the c that its bit decision I = d + c asks
    for.

    Parameters
    ----------
    signal : array, shape (14, zones)
        The cropped sequence I [kcps/SPAD].
    d : array, shape (zones,)
        DC offset: the signal while the marker does not transmit [kcps/SPAD].

    Returns
    -------
    PreambleFit
        Likelihood 0 where d is 0: nothing is received there.
    """
    s = signal - d
    c = _TEMPLATE @ s / (_TEMPLATE @ _TEMPLATE)
    residual = s - _TEMPLATE[:, None] * c
    e = np.sqrt(np.einsum('tz,tz->z', residual, residual))
    likelihood = np.divide(c * c, (e + 1) * d, out=np.zeros_like(d), where=d > 0)
    return PreambleFit(c, e, likelihood)
