# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detection methods by name."""

from __future__ import annotations

from retrolidar_ros.code import BIT_PERIOD_S
from retrolidar_ros.detector.detection import Detector
from retrolidar_ros.detector.paper import LIKELIHOOD_THRESHOLD, PaperDetector
from retrolidar_ros.frame import ZoneGrid

METHODS = ('paper',)


def create_detector(
    method: str,
    grid: ZoneGrid,
    *,
    bit_period_s: float = BIT_PERIOD_S,
    likelihood_threshold: float = LIKELIHOOD_THRESHOLD,
) -> Detector:
    """Return a new detector.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    grid : ZoneGrid
        The zones of the frames to come.
    bit_period_s : float
        How long a marker holds a bit [s].
    likelihood_threshold : float
        Least likelihood l of a preamble (method `paper`).

    Raises
    ------
    ValueError
        If there is no such method, or a parameter is impossible.
    """
    if method not in METHODS:
        raise ValueError(f'unknown method {method!r}; there is {", ".join(METHODS)}')
    if not bit_period_s > 0:
        raise ValueError(f'bit_period of {bit_period_s} s: it must be positive')
    if not likelihood_threshold > 0:
        raise ValueError(f'likelihood_threshold of {likelihood_threshold}: it must be positive')
    return PaperDetector(grid, bit_period_s=bit_period_s, likelihood_threshold=likelihood_threshold)
