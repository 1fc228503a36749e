# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 2b: where a preamble may have begun, so that little is left to search."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE
from retrolidar_ros.detector.evidence import NoiseLaw
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.words import template_energy

EIGHTHS = 8
"""Steps of a bit at which packets are looked for: quarters of a sample."""
# Least correlation of fourteen samples with the preamble. What is read at the limit of the reach
# has 0.77 ± 0.12; noise passes in one of twenty places.
_LEAST = 0.45
# What a preamble must deviate more than the noise law. At the limit of the reach it is 2.2 ± 0.8.
_LEAST_VARIANCE = 1.15
# The preamble alone may be hidden: whoever has lost half of it is not judged by it.
_LEAST_TOLD = 8.0
_HEAD_SAMPLES = 2 * len(PREAMBLE)
# How much sooner or later than by its nominal clock a packet may end [eighths]. One percent is
# two and a half, but a preamble is credible some eighths beside its place, too.
_EARLY_OR_LATE = 2


class Starts:
    """Remembers when packets whose preambles were credible will have ended, in every zone.

    A preamble is a poor mark for a start, but few places look like one at all. They can be found
    long before their packets end, many at a time; the search is then left with these places.
    """

    def __init__(self, zones: int, bit_s: float) -> None:
        """Remember for `zones` zones; bits last about `bit_s`."""
        self._step_s = bit_s / EIGHTHS
        self._ends = np.zeros((4 * PACKET_BITS * EIGHTHS, zones), dtype=bool)
        self._looked = 0

    def clear(self) -> None:
        """Forget all."""
        self._ends[:] = False
        self._looked = 0

    @property
    def looked_s(self) -> float:
        """Up to when starts have been looked for [s]."""
        return self._looked * self._step_s

    def look(self, view: View, last_s: float, law: NoiseLaw, noise_scale: float) -> None:
        """Look for preambles that have ended since the last time, in all zones.

        Parameters
        ----------
        view : View
            Of all zones, from a preamble's length before the last look on.
        last_s : float
            When the last exposure ended [s].
        law, noise_scale
            What the sensor's noise is.
        """
        span = len(PREAMBLE) * EIGHTHS
        earliest = math.ceil(float(view.begin_s[0]) / self._step_s)
        first = max(self._looked + 1 - span, earliest)
        last = math.floor(last_s / self._step_s)
        self._looked = last
        count = last - first - span + 1
        if count <= 0:
            return
        total, position = view.cumulated(np.arange(first, last + 1) * self._step_s)
        zones = len(view.zones)
        light = total[EIGHTHS:, :zones] - total[:-EIGHTHS, :zones]
        head = total[span:] - total[:-span]
        samples = (position[span:] - position[:-span])[:, None]
        told = head[:, 2 * zones :] if head.shape[1] > 2 * zones else samples
        mean = head[:, :zones] / np.maximum(samples, 1.0)
        energy = head[:, zones : 2 * zones] - head[:, :zones] * mean
        dark = np.zeros_like(mean)
        dark_samples = np.zeros(count)
        for bit in np.flatnonzero(PREAMBLE) * EIGHTHS:
            dark += light[bit : bit + count]
            at = position[bit : bit + count + EIGHTHS]
            dark_samples += at[EIGHTHS:] - at[:-EIGHTHS]
        common = dark_samples[:, None] * mean - dark
        phase = position[:count] % 1.0
        # No two dark bits of the preamble follow each other.
        template = template_energy(np.count_nonzero(PREAMBLE), 0, _HEAD_SAMPLES, phase)
        noise = noise_scale * law.variance(mean + view.mean)
        least = np.maximum(_LEAST**2, 0.75 - 2.5 * noise * told / np.maximum(energy, 1e-9))
        full = energy * template[:, None] * (told / _HEAD_SAMPLES)
        credible = (common > 0) & (common * common > least * full)
        credible &= energy > _LEAST_VARIANCE * noise * told
        credible |= told < _LEAST_TOLD
        self._mark(first, credible)

    def _mark(self, first: int, credible: NDArray[np.bool_]) -> None:
        """Note when packets that began at `first` and later will have ended."""
        reach = _EARLY_OR_LATE
        wide = np.zeros((len(credible) + 2 * reach, credible.shape[1]), dtype=bool)
        for late in range(2 * reach + 1):
            wide[late : late + len(credible)] |= credible
        ends = first + PACKET_BITS * EIGHTHS - reach + np.arange(len(wide))
        rows = ends % len(self._ends)
        # The first ones were marked before by earlier starts, the others hold what is long past.
        fresh = 2 * reach
        self._ends[rows[:fresh]] |= wide[:fresh]
        self._ends[rows[fresh:]] = wide[fresh:]

    def ended(self, first: int, last: int) -> NDArray[np.bool_]:
        """Return which packets may have ended at eighths first..last, shape (ends, zones)."""
        ended: NDArray[np.bool_] = self._ends[np.arange(first, last + 1) % len(self._ends)]
        return ended
