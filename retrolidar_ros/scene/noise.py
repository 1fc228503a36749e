# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the sensor's own noise makes of signals and distances."""

from __future__ import annotations

import numpy as np

from retrolidar_ros.scene.description import Noise, Ranging
from retrolidar_ros.sensor.frame import Floats

_NEAREST_M = 1e-3


def noisy(
    signal: Floats, noise: Noise | None, rng: np.random.Generator, ambient: Floats | float = 0.0
) -> Floats:
    """Add noise to signals of any shape, in ambient light; none is ever reported as negative.

    Signals and ambient light are in kcps/SPAD.
    """
    if noise is None:
        return signal
    sigma: Floats = np.sqrt(noise.floor + noise.slope * signal + noise.ambient * ambient)
    return np.maximum(signal + sigma * rng.standard_normal(signal.shape), 0.0)


def deviating(
    distance: Floats, signal: Floats, ranging: Ranging | None, rng: np.random.Generator
) -> Floats:
    """Add to distances [m] of any shape the deviation that belongs to their signals.

    None is behind the sensor, however near its target is.
    """
    if ranging is None:
        return distance
    shot = np.divide(ranging.shot, signal, out=np.zeros_like(signal), where=signal > 0)
    sigma: Floats = np.hypot(shot, ranging.floor)
    return np.maximum(distance + sigma * rng.standard_normal(signal.shape), _NEAREST_M)
