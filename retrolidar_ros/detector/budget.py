# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is demanded of a packet, so that chance makes no more IDs than the budget allows."""

from __future__ import annotations

import math
from typing import NamedTuple

from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS, RESERVED_IDS

USUAL_FALSE_IDS_PER_HOUR = 0.1
_USUAL_WORDS = IDS - len(RESERVED_IDS)
_USUAL_ZONES = 16


class Demands(NamedTuple):
    """Log likelihood ratios [nats]."""

    evidence: float
    """Least, against nothing but noise and a level that wanders."""
    wandering: float
    """More of it, where the level wanders besides."""
    word: float
    """Most by which any other sequence of bits may be likelier."""
    margin: float
    """Least, against any other ID."""
    margin_of_more: float
    """The same where more packets may come, and a doubtful one can wait for them."""


def demands(false_ids_per_hour: float, *, zones: int, words: int, bit_s: float) -> Demands:
    """Return what is demanded for a budget of false IDs, over all zones.

    The constants are calibrated by simulation (`evaluate family`).
    """
    trials = (
        zones
        / _USUAL_ZONES
        * words
        / _USUAL_WORDS
        * BIT_PERIOD_S
        / bit_s
        / (false_ids_per_hour / USUAL_FALSE_IDS_PER_HOUR)
    )
    lenience = min(max(math.log(false_ids_per_hour / USUAL_FALSE_IDS_PER_HOUR), -4.0), 4.0)
    return Demands(
        evidence=26.0 + math.log(trials),
        wandering=6.0,
        word=8.0,
        margin=math.log(1e3) - lenience,
        margin_of_more=math.log(1e4) - lenience,
    )
