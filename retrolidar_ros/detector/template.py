# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What samples of a packet look like, the response of the liquid crystal included."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS
from retrolidar_ros.frame import Floats
from retrolidar_ros.liquid_crystal import Response

_RESPONSE = Response()


class Light(NamedTuple):
    """Mean transmission of markers during exposures, each field of shape (packets, samples)."""

    mean: Floats
    """0 to 1."""
    per_start: Floats
    """Its derivative by the start of the packet [1/s]."""
    per_bit: Floats
    """Its derivative by the bit period [1/s]."""


def packet_light(
    bits: NDArray[np.uint8],
    start_s: Floats,
    bit_s: Floats,
    repeats: NDArray[np.bool_],
    begin_s: Floats,
    end_s: Floats,
) -> Light:
    """Return what exposures see of packets.

    Parameters
    ----------
    bits : array of 0 and 1, shape (packets, 31)
        1 = dark.
    start_s, bit_s : array, shape (packets,)
        When a packet starts, and how long it holds a bit [s].
    repeats : array of bool, shape (packets,)
        Whether it is one of many back to back; a lone one has a bright marker before and after.
    begin_s, end_s : array, shape (samples,)
        Of the exposures [s].
    """
    packets = len(bits)
    level = np.ones((packets, PACKET_BITS + 1))
    level[:, :-1] -= bits
    before = np.roll(level, 1, axis=1)
    before[:, 0] = np.where(repeats, level[:, PACKET_BITS - 1], 1.0)
    bit_s = bit_s[:, None]
    elapsed = np.zeros((packets, PACKET_BITS + 1))
    whole_bit = np.broadcast_to(bit_s, (packets, PACKET_BITS))
    within = _RESPONSE.integral(before[:, :-1], level[:, :-1], whole_bit)
    np.cumsum(within, axis=1, out=elapsed[:, 1:])
    since = np.concatenate([begin_s, end_s]) - start_s[:, None]
    bit = np.floor(since / bit_s)
    passed = since - bit * bit_s
    sent: Floats = np.zeros((packets, 1))
    if repeats.any():
        cycles = np.where(repeats[:, None], np.floor(bit / PACKET_BITS), 0.0)
        bit -= cycles * PACKET_BITS
        sent = sent + cycles * elapsed[:, -1:]
    # A marker that sleeps is bright: its transmission integrates to the time.
    late = bit - np.minimum(bit, PACKET_BITS)
    early = np.minimum(bit, 0.0)
    passed = passed + late * bit_s
    index = (bit - late - early).astype(np.intp)
    row = np.arange(packets)[:, None]
    now, was = level[row, index], before[row, index]
    if (early < 0).any():
        asleep = early < 0
        now[asleep] = was[asleep] = 1.0
        passed = passed + early * bit_s
    integral, transmission = _RESPONSE.relaxation(was, now, passed)
    integral += elapsed[row, index] + sent
    # The integral is the bit period times a function of the time in bits.
    stretched = integral / bit_s - since / bit_s * transmission
    inverse = 1 / (end_s - begin_s)
    samples = len(begin_s)
    return Light(
        mean=(integral[:, samples:] - integral[:, :samples]) * inverse,
        per_start=(transmission[:, :samples] - transmission[:, samples:]) * inverse,
        per_bit=(stretched[:, samples:] - stretched[:, :samples]) * inverse,
    )
