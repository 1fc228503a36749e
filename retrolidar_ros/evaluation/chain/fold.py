# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Several packets of a marker too far away for one, laid on top of each other."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.detector.coherence import hard_errors
from retrolidar_ros.detector.fold import FoldSearch
from retrolidar_ros.detector.search import Demand
from retrolidar_ros.evaluation.chain.played import Played, only_zone, rounded
from retrolidar_ros.frame import Floats


def _contrast(value: Floats, dark: NDArray[np.uint8]) -> float:
    """Return how far dark and bright soft bits (31,) are apart, over their spread within."""
    one, other = value[dark == 1], value[dark == 0]
    squares = ((one - one.mean()) ** 2).sum() + ((other - other.mean()) ** 2).sum()
    return float((one.mean() - other.mean()) / math.sqrt(squares / (len(value) - 2)))


def _decibels(ratio: float) -> float | None:
    """Return an amplitude ratio [dB]; None where dark and bright are not even in order."""
    return round(20 * math.log10(ratio), 1) if ratio > 0 else None


def fold_stage(played: Played) -> dict[str, Any]:
    """Return the packets one by one and together, and what each correlates with its best ID.

    Raises
    ------
    ValueError
        If the search does not find what was read.
    """
    view, packets = played.view(), played.detection.packets
    search = FoldSearch(played.bank, BIT_PERIOD_S)
    last_s = float(view.end_s[-1])
    demand = played.demand(view, packets)
    candidate = search.folded(view, last_s, packets, demand)
    if candidate is None:
        raise ValueError('the search does not find what was read')
    fit = played.judged(only_zone(candidate, played.zone)).fit
    bit_s = float(fit.bit_s[0])
    start_s = float(fit.start_s[0])
    shift = round((float(candidate.begin_s[0]) - start_s) / bit_s)
    edges_s = start_s + bit_s * (shift + np.arange(PACKET_BITS * packets + 1))
    level = view.soft_bits(edges_s[None]).drifting()
    # In the order of the packet, whichever bit the window begins with.
    rows = np.roll(level.value[0, :, 0].reshape(packets, PACKET_BITS), shift, axis=1)
    bits = packet(candidate.ids)[0]
    folded = rows.sum(axis=0)
    alone = played.demand(view, 1)
    length_s = PACKET_BITS * bit_s
    singles = []
    for back in reversed(range(packets)):
        single = search.folded(view, last_s - back * length_s, 1, Demand(0.0, alone.noise))
        if single is not None:
            singles.append((int(single.ids[0]), round(float(single.correlation[0]), 3)))
    contrasts = [_contrast(row, bits) for row in rows]
    return {
        'range_m': round(float(np.linalg.norm(played.marker.position_m)), 2),
        'packets': packets,
        'id': int(candidate.ids[0]),
        'bits': bits.tolist(),
        'rows': [rounded(row, 2) for row in rows],
        'folded': rounded(folded, 2),
        'row_snr_db': [_decibels(contrast) for contrast in contrasts],
        'mean_row_snr_db': _decibels(sum(contrasts) / packets),
        'folded_snr_db': _decibels(_contrast(folded, bits)),
        'expected_gain_db': round(10 * math.log10(packets), 1),
        'hard_errors': [hard_errors(row, bits) for row in rows],
        'folded_hard_errors': hard_errors(folded, bits),
        'single_ids': [identity for identity, _ in singles],
        'single_correlation': [correlation for _, correlation in singles],
        'single_threshold': round(alone.correlation, 3),
        'correlation': round(float(candidate.correlation[0]), 3),
        'threshold': round(demand.correlation, 3),
        'sample_snr_db': round(played.detection.snr_db, 1),
    }
