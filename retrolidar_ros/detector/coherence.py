# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 5b: whether a packet is there in all its parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE
from retrolidar_ros.detector.candidates import Candidates
from retrolidar_ros.detector.fit import Fit
from retrolidar_ros.detector.view import View
from retrolidar_ros.frame import Floats

# First bits of the parts of a packet, each of which must show the modulation by itself: by this
# share of the gain of the whole, or less by so many standard deviations of its own.
_PARTS = np.array([0, len(PREAMBLE), 15, 23])
_LEAST_PART = 0.7
_PART_DEVIATIONS = 1.75


def hard_errors(dark: Floats, bits: NDArray[np.uint8]) -> int:
    """Return how many soft bits (31,) a receiver would take for the other ones."""
    middle = (dark[bits == 1].mean() + dark[bits == 0].mean()) / 2
    return int(np.count_nonzero((dark > middle) != (bits == 1)))


def erased_bits(presence: Floats) -> int:
    """Return how many bits are all but erased, of presences (bits,)."""
    return int(np.count_nonzero(presence < 0.25))


def coherent(candidate: Candidates, fit: Fit, view: View) -> bool:
    """Tell whether each part of the packet modulates as the whole does.

    A shape that is no packet, such as one long gap, may correlate with one by its longest runs
    alone; but then the preamble, or another part that changes fast, is missing.
    """
    signal, weight, light = view.signal[:, 0], fit.weight[0], fit.light[0]
    bit = np.floor(((view.begin_s + view.end_s) / 2 - fit.start_s[0]) / fit.bit_s[0])
    told = (weight > 0) & ((bit >= 0) | candidate.repeats[0])
    bit = bit[told].astype(np.intp)
    part = np.searchsorted(_PARTS, bit % PACKET_BITS, side='right') - 1
    place = (bit // PACKET_BITS) * len(_PARTS) + part
    place -= place.min()
    count, light_sum, signal_sum = (
        np.bincount(place, values) for values in (weight[told], light[told], signal[told])
    )
    filled = np.maximum(count, 1.0)
    within = light[told] - (light_sum / filled)[place]
    common = np.bincount(part, within * (signal[told] - (signal_sum / filled)[place]), len(_PARTS))
    energy = np.bincount(part, within * within, len(_PARTS))
    deviation = fit.deviation[0] / np.sqrt(np.maximum(energy, 1e-9))
    gain = common / np.maximum(energy, 1e-9)
    return bool((gain + _PART_DEVIATIONS * deviation > _LEAST_PART * fit.gain[0]).all())
