# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 2: the light that fell within every bit, wherever its edges lie between the frames."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

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
        """Integrate `values` (samples, zones) of exposures from begin to end (samples,)."""
        self._begin_s = begin_s
        self._per_s = 1 / (end_s - begin_s)
        self._values = values
        self._total = np.zeros((len(values) + 1, values.shape[1]))
        np.cumsum(values, axis=0, out=self._total[1:])

    def locate(self, time_s: Floats) -> tuple[Floats, Floats]:
        """Return for times (...) the exposure begun last and the share of it that has passed."""
        index = np.searchsorted(self._begin_s, time_s, side='right') - 1
        np.maximum(index, 0, out=index)
        share = (time_s - self._begin_s[index]) * self._per_s[index]
        return index, np.clip(share, 0.0, 1.0)

    def until(self, index: Floats, share: Floats) -> Floats:
        """Return the integral up to located times (...), shape (..., zones)."""
        total: Floats = self._values[index]
        total *= share[..., None]
        total += self._total[index]
        return total


class SoftBits(NamedTuple):
    """Bits without decision, for hypotheses on where they begin and how long they last.

    A packet correlates with the samples by the sum of the soft bits that it sends dark.
    """

    value: Floats
    """Darker than the mean, in samples · kcps/SPAD: shape (hypotheses, bits, zones)."""
    energy: Floats
    """Squared deviation of the samples [(kcps/SPAD)²], shape (hypotheses, zones)."""
    samples: Floats
    """How many samples the bits span, shape (hypotheses,)."""
    phase: Floats
    """Where in an exposure the middle bit begins, 0 to 1, shape (hypotheses,)."""


def soft_bits(
    integral: Integral,
    squares: Integral,
    edges_s: Floats,
    *,
    silent_s: float = 0.0,
    line: bool = True,
) -> SoftBits:
    """Integrate over bits and take off what is not modulation.

    A straight line may be taken off, as a marker on the move or a lamp draws it. With silence
    before the packet it would be taken for such a line: there only the mean is taken off, to
    which the silence contributes. The bright level is known then, and dark bits stand out more.

    Parameters
    ----------
    integral, squares : Integral
        Of the signals and of their squares.
    edges_s : array, shape (hypotheses, bits + 1)
        Where the bits begin, and the last one ends [s].
    silent_s : float
        How long before the packet the marker was silent [s].
    line : bool
        Whether to take off a straight line, too; not together with silence.
    """
    index, share = integral.locate(edges_s)
    light = np.diff(integral.until(index, share), axis=1)
    position = index + share
    count = np.diff(position, axis=1)
    outer_index, outer_share = index[:, [0, -1]], share[:, [0, -1]]
    phase = share[:, share.shape[1] // 2]
    if silent_s:
        before_index, before_share = integral.locate(edges_s[:, 0] - silent_s)
        outer_index = np.stack([before_index, index[:, -1]], axis=1)
        outer_share = np.stack([before_share, share[:, -1]], axis=1)
        ends = integral.until(outer_index, outer_share)
        total = ends[:, 1] - ends[:, 0]
    else:
        total = light.sum(axis=1)
    square_ends = squares.until(outer_index, outer_share)
    outer = outer_index + outer_share
    samples = outer[:, 1] - outer[:, 0]
    mean = total / np.maximum(samples, 1.0)[:, None]
    energy = square_ends[:, 1] - square_ends[:, 0] - total * mean
    value = count[:, :, None] * mean[:, None, :] - light
    if line:
        bits = value.shape[1]
        ramp = np.arange(bits) - (bits - 1) / 2
        norm = ramp @ ramp
        slope = np.einsum('b,hbz->hz', ramp, value) / norm
        value -= ramp[:, None] * slope[:, None, :]
        per_bit = samples / bits
        energy -= slope * slope * (norm / np.maximum(per_bit, 1e-9))[:, None]
    return SoftBits(value, np.maximum(energy, 1e-9), samples, phase)
