# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Some zones over the time that a search looks at, integrated and ready to be cut into bits."""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.soft_bits import Integral, SoftBits
from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import Floats

# Distances further apart than this are two targets; the sensor parts them from 0.6 m on.
_GAP_M = 0.5
# A nearer target in a smaller share of the frames than this is passing by.
_HIDING = 0.2


class View:
    """The samples of some zones: erasures filled, the marker's own target told from others."""

    def __init__(
        self,
        zones: NDArray[np.intp],
        begin_s: Floats,
        end_s: Floats,
        signal: Floats,
        weight: Floats,
        ceiling: Floats,
    ) -> None:
        """Look at `zones` in exposures (samples,) from begin to end [s].

        Parameters
        ----------
        zones : array of int, shape (zones,)
        begin_s, end_s : array, shape (samples,)
        signal, weight : array, shape (samples, zones)
            [kcps/SPAD]; weight 0 for erasures.
        ceiling : array, shape (samples, zones)
            Where another target outshone the marker: what its signal was less than
            [kcps/SPAD]; 0 elsewhere.
        """
        self.zones = zones
        self.begin_s, self.end_s = begin_s, end_s
        self.signal, self.weight, self.ceiling = signal, weight, ceiling

    @classmethod
    def of(cls, samples: Samples, zones: NDArray[np.intp]) -> View:
        """Look at some zones of `samples`."""
        signal, weight, ceiling = _of_one_target(
            samples.signal[:, zones], samples.weight[:, zones], samples.distance[:, zones]
        )
        return cls(zones, samples.begin_s, samples.end_s, signal, weight, ceiling)

    def only(self, zone: int) -> View:
        """Return the view of one of all zones."""
        column = np.array([zone])
        return View(
            column,
            self.begin_s,
            self.end_s,
            self.signal[:, column],
            self.weight[:, column],
            self.ceiling[:, column],
        )

    @cached_property
    def mean(self) -> Floats:
        """Mean signal [kcps/SPAD], shape (zones,)."""
        told = np.maximum(self.weight.sum(axis=0), 1.0)
        mean: Floats = (self.signal * self.weight).sum(axis=0) / told
        return mean

    @cached_property
    def _integral(self) -> Integral:
        # About the mean, sums of squares keep their precision; and erasures lie on it.
        centred: Floats = self.signal - self.mean
        columns: list[Floats]
        if self.weight.all():
            columns = [centred, centred * centred]
        else:
            centred *= self.weight
            columns = [centred, centred * centred, self.weight]
        return Integral(self.begin_s, self.end_s, np.concatenate(columns, axis=1))

    def cumulated(self, time_s: Floats) -> tuple[Floats, Floats]:
        """Return integrals, and exposures passed, until times (times,).

        The integrals are of the signal about its mean, of its square and, if there are
        erasures, of the weights: shape (times, zones · 2 or 3).
        """
        index, share = self._integral.locate(time_s)
        return self._integral.until(index, share, slice(None)), index + share

    def presence(self, edges_s: Floats) -> Floats:
        """Return the share of each bit between edges (bits + 1) that tells, shape (bits,).

        Of a view of one zone.
        """
        total, position = self.cumulated(edges_s)
        share: Floats = np.diff(total[:, 2] if total.shape[1] > 2 else position) / 2
        return share

    def soft_bits(self, edges_s: Floats, silent_s: float = 0.0) -> SoftBits:
        """Return the bits between edges (hypotheses, bits + 1) [s], and the silence before."""
        return SoftBits(self._integral, len(self.zones), edges_s, silent_s)


def _of_one_target(
    signal: Floats, weight: Floats, distance: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return signal, weight and ceiling (`View`) of the target that may be a marker.

    When a marker turns dark and what stands behind it or before it is stronger, the sensor
    reports that instead, and its distance says so. However bright that is, the marker is dark,
    or at least no brighter. Something nearer that is seen for a short while only has hidden the
    marker: what it sent then is not known.
    """
    ceiling = np.zeros_like(signal)
    nearest = np.fmin.reduce(distance, axis=0)
    spread = np.fmax.reduce(distance, axis=0) - nearest
    two = np.flatnonzero(spread > _GAP_M)
    if not len(two):
        return signal, weight, ceiling
    signal, weight = signal.copy(), weight.copy()
    for zone in two:
        range_m = distance[:, zone]
        ordered = np.sort(range_m[np.isfinite(range_m)])
        with np.errstate(invalid='ignore'):
            passing = range_m < ordered[len(ordered) // 2] - _GAP_M
        if 0 < np.count_nonzero(passing) < _HIDING * len(ordered):
            signal[passing, zone] = 0.0
            weight[passing, zone] = 0.0
            ordered = ordered[np.count_nonzero(passing) :]
        gaps = np.diff(ordered)
        widest = int(gaps.argmax())
        if gaps[widest] < _GAP_M:
            continue
        with np.errstate(invalid='ignore'):
            far = range_m > (ordered[widest] + ordered[widest + 1]) / 2
        near = np.isfinite(range_m) & ~far & (weight[:, zone] > 0)
        other = far if signal[near, zone].mean() >= signal[far, zone].mean() else near
        ceiling[other, zone] = signal[other, zone]
        signal[other, zone] = 0.0
    return signal, weight, ceiling
