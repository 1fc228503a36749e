# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the package knows of a sensor; `create_detector` takes a `SensorModel` of another one."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np
from numpy.typing import ArrayLike, NDArray


class Status(IntEnum):
    """The sensor's target status codes that the package distinguishes (ST UM3109 §5.5)."""

    NOT_UPDATED = 0
    SIGNAL_TOO_LOW_ON_ARRAY = 1
    SIGMA_TOO_HIGH = 3
    VALID = 5
    FIRST_RANGE = 6  # no wrap-around check: the previous frame had no target here
    SIGNAL_TOO_LOW = 8
    MERGED = 9  # valid, large pulse: perhaps two targets nearer than 600 mm to each other
    NO_PREVIOUS_TARGET = 10  # valid, but the previous range showed no target
    NO_TARGET = 255


@dataclass(frozen=True)
class NoiseLaw:
    """Frame-to-frame variance of the signal S of a zone in ambient light A: floor + a·S + b·A.

    Photons arrive at random; b is a if signal and ambient light are counted in the same gate, and
    smaller if ambient light is counted over a longer time.
    """

    floor: float = 4.6  # [(kcps/SPAD)²]
    slope: float = 0.22  # a [kcps/SPAD]
    ambient: float = 0.22  # b [kcps/SPAD]

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

    def variance(self, signal: NDArray[np.floating]) -> NDArray[np.floating]:
        """Return the variance [(kcps/SPAD)²] at signals [kcps/SPAD] of any shape."""
        variance: NDArray[np.floating] = self.floor + self.slope * np.maximum(signal, 0.0)
        return variance


@dataclass(frozen=True)
class SensorModel:
    """A sensor that measures signal and distance in zones; by default, a VL53L8CX."""

    field_of_view: float = 4 * 0.21498  # all zones as a tangent (46.5°); lenses differ a little
    zone_blur: float = 0.0  # deviation of the optics' blur in widths of a zone; 0 = not known
    range_offset_m: float = 0.0  # by how much it measures all ranges too long [m]
    exposure: float = 1.0  # share of the frame period in which it counts light, about the stamp
    noise: NoiseLaw = field(default_factory=NoiseLaw)  # of a public recording at 8x8, 10 Hz
    ranging_shot: float = 0.490  # deviation of a distance at one kcps/SPAD; falls with more [m]
    ranging_floor_m: float = 0.0016  # the same of the brightest target [m]
    signal_step: float = 1 / 2048  # smallest step of a signal [kcps/SPAD]
    low_signal: float = 8.0  # most of a signal that is called too low, if all is well [kcps/SPAD]
    max_signal: float = 2.0**21  # upper bound of a signal: 32 bits of the smallest step [kcps/SPAD]
    distance_step_m: float = 0.25e-3  # smallest step of a distance [m]
    max_distance_m: float = 8.192  # 16 bits of the smallest step, one of them its sign
    separable_m: float = 0.6  # two targets in a zone that are nearer to each other merge (UM3109)
    # Statuses of a valid signal and distance: a blinking marker itself makes a VL53L8CX report
    # FIRST_RANGE and NO_PREVIOUS_TARGET at its dark-to-bright edges.
    valid: tuple[int, ...] = (
        Status.VALID,
        Status.FIRST_RANGE,
        Status.MERGED,
        Status.NO_PREVIOUS_TARGET,
    )
    nothing: tuple[int, ...] = (Status.NO_TARGET,)  # a marker may be dark
    faint: tuple[int, ...] = (Status.SIGNAL_TOO_LOW,)  # no target, up to `low_signal`


VL53L8CX = SensorModel()
