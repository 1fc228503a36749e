# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Step response of a liquid crystal: exponential (paper §2.2)."""

import math
from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.section import quantity

_Time: TypeAlias = Annotated[float, quantity('time', 1e-6, 0.1)]

_TIME_CONSTANTS_10_TO_90 = math.log(9)  # an exponential runs from 10 to 90 % in ln 9 time constants


@dataclass(frozen=True)
class Response:
    """Times in which the liquid crystal darkens and brightens, from 10 to 90 % [s]."""

    dark_s: _Time
    bright_s: _Time

    def integral(self, before: Floats, level: Floats, elapsed_s: Floats) -> Floats:
        """Return the integral of the relaxation from one level to the next [s].

        Levels are transmissions, 0 to 1, and `elapsed_s` is the time since the edge between them;
        all are of one shape (...). A bit lasts many time constants, so it starts at the level
        `before`.
        """
        step = before - level
        tau = np.where(step > 0, self.dark_s, self.bright_s) / _TIME_CONSTANTS_10_TO_90
        share = np.divide(elapsed_s, tau, out=np.full_like(elapsed_s, np.inf), where=tau > 0)
        gone = np.expm1(-np.maximum(share, 0.0))  # before the edge nothing has changed
        integral: Floats = level * elapsed_s - step * tau * gone
        return integral
