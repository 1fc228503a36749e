# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Noise of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class NoiseLaw:
    """Frame-to-frame variance of the signal S of a zone in ambient light A: floor + a·S + b·A.

    Photons arrive at random; b is a if signal and ambient light are counted in the same gate, and
    smaller if ambient light is counted over a longer time.
    """

    floor: float = 4.6
    """[(kcps/SPAD)²]"""
    slope: float = 0.22
    """a [kcps/SPAD]"""
    ambient: float = 0.22
    """b [kcps/SPAD]"""

    def __post_init__(self) -> None:
        """Raise ValueError for a law without noise."""
        if not (self.floor > 0 and self.slope >= 0 and self.ambient >= 0):
            raise ValueError(
                f'noise of floor {self.floor}, slope {self.slope}, ambient {self.ambient}: the '
                'floor must be positive and the others not negative'
            )

    def lit(self, ambient: ArrayLike) -> NoiseLaw:
        """Return the law at the mean of ambient light [kcps/SPAD], whose noise joins the floor."""
        light = np.asarray(ambient, dtype=np.float64)
        mean = float(np.where(np.isfinite(light) & (light > 0), light, 0.0).mean())
        return NoiseLaw(self.floor + self.ambient * mean, self.slope, 0.0)

    def variance(self, signal: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
        """Return the variance [(kcps/SPAD)²] at signals [kcps/SPAD] of any shape."""
        variance: NDArray[np.floating[Any]] = self.floor + self.slope * np.maximum(signal, 0.0)
        return variance
