# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Thresholds of the decision, for a budget of false IDs per hour."""

import math
from typing import NamedTuple

from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS, RESERVED_IDS

USUAL_FALSE_IDS_PER_HOUR = 0.1
_USUAL_WORDS = IDS - len(RESERVED_IDS)
_USUAL_ZONES = 16


class Thresholds(NamedTuple):
    """Thresholds of log likelihood ratios [nats]."""

    evidence: float  # minimum ratio to noise and a wandering level
    wandering: float  # added to it where the level wanders
    word: float  # maximum log likelihood ratio of another bit sequence
    margin: float  # minimum ratio to any other ID
    margin_of_more: float  # the same if more packets may follow: then an ambiguous one can wait


def thresholds(false_ids_per_hour: float, *, zones: int, words: int, bit_s: float) -> Thresholds:
    """Return the thresholds for a budget over all zones (`evaluation.experiments.roc`)."""
    trials = (zones / _USUAL_ZONES) * (words / _USUAL_WORDS) * (BIT_PERIOD_S / bit_s)
    allowed = false_ids_per_hour / USUAL_FALSE_IDS_PER_HOUR
    lenience = min(max(math.log(allowed), -4.0), 4.0)
    return Thresholds(
        evidence=26.0 + math.log(trials / allowed),
        wandering=6.0,
        word=8.0,
        margin=math.log(1e3) - lenience,
        margin_of_more=math.log(1e4) - lenience,
    )
