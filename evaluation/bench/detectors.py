# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detectors that the experiments compare: the only place where they are made."""

from __future__ import annotations

from typing import Any

from retrolidar_ros.detector import Detector, create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.sensor.frame import ZoneGrid


def new_detector(
    method: str,
    grid: ZoneGrid,
    *,
    bit_period_s: float = BIT_PERIOD_S,
    strictness: float | None = None,
) -> Detector:
    """Return a new detector.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    grid : ZoneGrid
        The zones of the frames to come.
    bit_period_s : float
        How long the detector believes that a marker holds a bit [s].
    strictness : float or None
        A value of the method's knob, see `knob`; None = as shipped.
    """
    options: dict[str, Any] = {} if strictness is None else {knob(method)[0]: strictness}
    return create_detector(method, grid, bit_period_s=bit_period_s, **options)


def knob(method: str) -> tuple[str, tuple[float, ...]]:
    """Return the parameter that decides between too many readings and too few.

    Returns
    -------
    name : str
        Of the parameter of `create_detector`.
    values : tuple of float
        Five, from lax to strict.
    """
    if method == 'paper':
        return 'likelihood_threshold', (0.1, 0.2, 0.3, 0.38, 0.5)
    return 'false_ids_per_hour', (1000.0, 100.0, 10.0, 1.0, 0.1)
