# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How a budget of false IDs is shared by all that is tried."""

from __future__ import annotations

from collections.abc import Mapping

from retrolidar_ros.code import PACKET_BITS
from retrolidar_ros.detector.starts import EIGHTHS

# Share of the zones and hours that are expected to look active (`activity`), for noise or for what
# is not noise.
_ACTIVE = 1 / 16
# How many hypotheses a look at a fold tries, for every word: any of 31 bits, eight phases and up
# to eleven clocks.
_HYPOTHESES_A_FOLD = PACKET_BITS * EIGHTHS * 11.0
# How the budget is shared: packets that have just ended, and folds of any stretch.
_ENDED_SHARE = 0.5


def granted_chances(
    false_ids_per_hour: float,
    *,
    zones: int,
    words: int,
    bit_s: float,
    hypotheses_a_sample: float,
    fold_bits: Mapping[int, int],
) -> dict[int, float]:
    """Return what chance noise is granted with each hypothesis.

    Parameters
    ----------
    false_ids_per_hour : float
        The budget, over all zones.
    zones, words : int
        How many.
    bit_s : float
        How long a bit is [s].
    hypotheses_a_sample : float
        How many the search for packets that have just ended tries, for every word.
    fold_bits : mapping of int to int
        Bits between two looks at any stretch, by how many packets are folded.

    Returns
    -------
    dict
        By how many packets are folded, 0 for packets that have just ended.
    """
    active_s = zones * _ACTIVE * 3600
    ended = active_s / (bit_s / 2) * hypotheses_a_sample * words
    chances = {0: false_ids_per_hour * (_ENDED_SHARE if fold_bits else 1.0) / ended}
    for fold, every_bits in fold_bits.items():
        looks = active_s / (every_bits * bit_s)
        share = (1 - _ENDED_SHARE) / len(fold_bits)
        chances[fold] = false_ids_per_hour * share / (looks * _HYPOTHESES_A_FOLD * words)
    return chances
