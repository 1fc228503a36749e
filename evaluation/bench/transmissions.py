# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What share of the light many markers let through, all at once."""

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.sensor.frame import Floats


def transmission(
    edges_s: Floats,
    ids: NDArray[np.int64],
    start_s: Floats,
    bit_s: Floats,
    response: Response,
    packets: float = 1,
) -> Floats:
    """Return what share of the light markers let through, 0 to 1, shape (frames, markers).

    The edges [s] are the beginnings of the exposures and the end of the last, shape (frames + 1,),
    or both of each, shape (frames, 2). Markers begin their first packets at `start_s`, hold a bit
    for `bit_s`, and send some packets (infinity = without end) before they stay bright.
    """
    levels = 1.0 - packet(ids)
    before = np.roll(levels, 1, axis=1)
    whole = response.integral(before, levels, np.broadcast_to(bit_s[:, None], levels.shape))
    elapsed = np.concatenate([np.zeros((len(ids), 1)), np.cumsum(whole, axis=1)], axis=1)
    # The very first bit follows the bright state of a silent marker.
    excess = response.integral(np.ones(len(ids)), levels[:, 0], bit_s) - whole[:, 0]
    since = edges_s.reshape(-1, 1) - start_s
    bits = np.clip(np.floor(since / bit_s), 0, packets * PACKET_BITS)
    cycles, place = np.divmod(bits, PACKET_BITS)
    index = np.arange(len(ids)), place.astype(np.intp)
    level = np.where(bits == packets * PACKET_BITS, 1.0, levels[index])
    from_level = np.where(bits == 0, 1.0, before[index])
    within = response.integral(from_level, level, np.maximum(since - bits * bit_s, 0.0))
    sent = cycles * elapsed[:, -1] + elapsed[index] + np.where(bits > 0, excess, 0.0) + within
    passed = np.where(since < 0, since, sent).reshape(*edges_s.shape, len(ids))
    axis = edges_s.ndim - 1
    share: Floats = np.diff(passed, axis=axis) / np.diff(edges_s, axis=axis)[..., None]
    return share.reshape(-1, len(ids))
