# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Some zones over the time that a search looks at, integrated and ready to be cut into bits."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.soft_bits import Integral
from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import Floats

# Distances further apart than this are two targets; the sensor parts them from 0.6 m on.
_GAP_M = 0.5


class View:
    """The samples of some zones: erasures filled, the marker's own target told from others."""

    def __init__(
        self,
        zones: NDArray[np.intp],
        begin_s: Floats,
        end_s: Floats,
        signal: Floats,
        weight: Floats,
    ) -> None:
        """Look at signals (samples, zones) with their weights in exposures from begin to end."""
        self.zones = zones
        self.begin_s, self.end_s = begin_s, end_s
        self.signal, self.weight = signal, weight
        self.complete = bool(weight.all())
        if self.complete:
            self.mean: Floats = signal.mean(axis=0)
            centred = signal - self.mean
        else:
            told = np.maximum(weight.sum(axis=0), 1.0)
            self.mean = (signal * weight).sum(axis=0) / told
            centred = (signal - self.mean) * weight
            self._presence = Integral(begin_s, end_s, weight)
        self.integral = Integral(begin_s, end_s, centred)
        self.squares = Integral(begin_s, end_s, centred * centred)

    @classmethod
    def of(cls, samples: Samples, zones: NDArray[np.intp], exposure_s: float) -> View:
        """Look at some zones of `samples`."""
        begin_s, end_s = samples.exposures(exposure_s)
        signal = _of_one_target(samples.signal[:, zones], samples.distance[:, zones])
        return cls(zones, begin_s, end_s, signal, samples.weight[:, zones])

    def present(self, begin_s: Floats, end_s: Floats) -> Floats:
        """Return the samples that are no erasures between times (...): shape (..., zones or 1)."""
        index, share = self.integral.locate(np.stack([begin_s, end_s]))
        if self.complete:
            position = index + share
            return (position[1] - position[0])[..., None]
        total = self._presence.until(index, share)
        return total[1] - total[0]


def _of_one_target(signal: Floats, distance: Floats) -> Floats:
    """Return the signal of the target that is the brighter one, 0 where another is reported.

    When a marker turns dark and what stands behind it or before it is stronger, the sensor
    reports that instead, and its distance says so. However bright that is, the marker is dark.
    """
    nearest = np.fmin.reduce(distance, axis=0)
    spread = np.fmax.reduce(distance, axis=0) - nearest
    two = np.flatnonzero(spread > _GAP_M)
    if not len(two):
        return signal
    signal = signal.copy()
    for zone in two:
        ordered = np.sort(distance[:, zone])
        ordered = ordered[np.isfinite(ordered)]
        gaps = np.diff(ordered)
        widest = int(gaps.argmax())
        if gaps[widest] < _GAP_M:
            continue
        with np.errstate(invalid='ignore'):
            far = distance[:, zone] > (ordered[widest] + ordered[widest + 1]) / 2
        near = np.isfinite(distance[:, zone]) & ~far
        other = far if signal[near, zone].mean() >= signal[far, zone].mean() else near
        signal[other, zone] = 0.0
    return signal
