# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 2: the light that fell within every bit, wherever its edges lie between the frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.frame import Floats

SILENT_BITS = 16
"""How much of the time before a packet tells the bright level of a marker that slept."""


class Integral:
    """The running integral over time of what some zones received.

    It is linear within an exposure and constant between two of them, so a bit that begins or
    ends within an exposure gets that share of it. Everything counts in samples: a whole
    exposure adds its value once.
    """

    def __init__(self, begin_s: Floats, end_s: Floats, values: Floats) -> None:
        """Integrate `values` (samples, columns) of exposures from begin to end (samples,)."""
        self._begin_s = begin_s
        self._per_s = 1 / (end_s - begin_s)
        self._values = values
        self._total = np.empty((len(values) + 1, values.shape[1]))
        self._total[0] = 0.0
        np.cumsum(values, axis=0, out=self._total[1:])

    def locate(self, time_s: Floats) -> tuple[NDArray[np.intp], Floats]:
        """Return for times (...) the exposure begun last and the share of it that has passed."""
        index = self._begin_s.searchsorted(time_s, side='right') - 1
        np.maximum(index, 0, out=index)
        share = (time_s - self._begin_s[index]) * self._per_s[index]
        np.maximum(share, 0.0, out=share)
        np.minimum(share, 1.0, out=share)
        return index, share

    def until(self, index: NDArray[np.intp], share: Floats, columns: slice) -> Floats:
        """Return the integral up to located times (...), shape (..., columns)."""
        total: Floats = self._values[:, columns].take(index, axis=0)
        total *= share[..., None]
        total += self._total[:, columns].take(index, axis=0)
        return total


class Level(NamedTuple):
    """What is taken off soft bits before they are compared with packets."""

    value: Floats
    """Soft bits, darker than the rest: samples · kcps/SPAD, shape (hypotheses, bits, zones)."""
    energy: Floats
    """Squared deviation of the samples [(kcps/SPAD)²], shape (hypotheses, zones)."""
    told: Floats
    """How many samples that tell there are, shape (hypotheses, 1 or zones)."""


class SoftBits:
    """Bits without decision, for hypotheses on where they begin and how long they last.

    A packet correlates with the samples by the sum of the soft bits that it sends dark.
    """

    def __init__(self, integral: Integral, zones: int, edges_s: Floats, silent_s: float) -> None:
        """Integrate over bits.

        Parameters
        ----------
        integral : Integral
            Of the signals, their squares and, if there are erasures, of the weights: columns
            (zones, zones[, zones]).
        zones : int
            How many.
        edges_s : array, shape (hypotheses, bits + 1)
            Where the bits begin, and the last one ends [s].
        silent_s : float
            How long before the packet the marker may have been silent [s].
        """
        times_s = np.empty((len(edges_s), edges_s.shape[1] + 1))
        times_s[:, 0] = edges_s[:, 0] - silent_s
        times_s[:, 1:] = edges_s
        index, share = integral.locate(times_s)
        until = integral.until(index[:, 1:], share[:, 1:], slice(0, zones))
        self._light = until[:, 1:] - until[:, :-1]
        position = index + share
        self._count = position[:, 2:] - position[:, 1:-1]
        self.phase: Floats = share[:, 1 + share.shape[1] // 2]
        """Where in an exposure the middle bit begins, 0 to 1, shape (hypotheses,)."""
        outer = [0, 1, -1]
        self._outer = integral.until(index[:, outer], share[:, outer], slice(None))
        self._position = position[:, outer]
        self._zones = zones

    def _total(self, first: int) -> tuple[Floats, Floats, Floats, Floats]:
        """Return sums of signal, square and weight since the silence (0) or the packet (1)."""
        zones = self._zones
        total = self._outer[:, 2] - self._outer[:, first]
        samples = np.maximum(self._position[:, 2] - self._position[:, first], 1e-3)[:, None]
        told = total[:, 2 * zones :] if total.shape[1] > 2 * zones else samples
        told = np.maximum(told, 1e-3)
        return total[:, :zones], total[:, zones : 2 * zones], told, samples

    def drifting(self) -> Level:
        """Take off a straight line, as a marker on the move or a lamp draws it."""
        level = self.steady(1)
        bits = self._light.shape[1]
        ramp = np.arange(bits) - (bits - 1) / 2
        norm = float(ramp @ ramp)
        slope = np.matmul(ramp, level.value) / norm
        value = level.value - ramp[:, None] * slope[:, None, :]
        energy = level.energy - slope * slope * (norm * bits / level.told)
        return Level(value, np.maximum(energy, 1e-9), level.told)

    def steady(self, first: int) -> Level:
        """Take off the mean: since the silence began (0), or since the packet did (1).

        After silence the bright level is known, and dark bits stand out more.
        """
        total, square, told, samples = self._total(first)
        mean = total / samples
        value = self._count[:, :, None] * mean[:, None, :] - self._light
        energy = np.maximum(square - total * mean, 1e-9)
        return Level(value, energy, told)
