# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What samples of a packet look like, the response of the liquid crystal included."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS
from retrolidar_ros.frame import Floats
from retrolidar_ros.liquid_crystal import Response

_RESPONSE = Response()


def packet_light(
    bits: NDArray[np.uint8],
    start_s: Floats,
    bit_s: Floats,
    repeats: NDArray[np.bool_],
    begin_s: Floats,
    end_s: Floats,
) -> Floats:
    """Return the mean transmission of markers during exposures.

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

    Returns
    -------
    array, shape (packets, samples)
        0 to 1.
    """
    packets = len(bits)
    level = np.ones((packets, PACKET_BITS + 1))
    level[:, :-1] -= bits
    before = np.roll(level, 1, axis=1)
    before[:, 0] = np.where(repeats, level[:, PACKET_BITS - 1], 1.0)
    whole_bit = np.broadcast_to(bit_s[:, None], (packets, PACKET_BITS))
    within = _RESPONSE.integral(before[:, :-1], level[:, :-1], whole_bit)
    elapsed = np.zeros((packets, PACKET_BITS + 1))
    np.cumsum(within, axis=1, out=elapsed[:, 1:])

    def integral(time_s: Floats) -> Floats:
        since = time_s[None, :] - start_s[:, None]
        bit = np.floor(since / bit_s[:, None])
        cycles = np.where(repeats[:, None], bit // PACKET_BITS, 0.0)
        bit = np.clip(bit - cycles * PACKET_BITS, 0, PACKET_BITS).astype(np.intp)
        rows = np.arange(packets)[:, None]
        passed = since - (cycles * PACKET_BITS + bit) * bit_s[:, None]
        partial = _RESPONSE.integral(before[rows, bit], level[rows, bit], np.maximum(passed, 0.0))
        sent = cycles * elapsed[:, -1:] + elapsed[rows, bit] + partial
        return np.where(repeats[:, None] | (since >= 0), sent, since)

    light: Floats = (integral(end_s) - integral(begin_s)) / (end_s - begin_s)
    return light
