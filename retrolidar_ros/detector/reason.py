# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why a candidate is refused."""

from __future__ import annotations

from enum import Enum

from retrolidar_ros.core import lib


class Reason(str, Enum):
    """Reasons, as diagnostics and tables name them."""

    EVIDENCE = 'evidence'
    """Noise and a wandering level explain the samples nearly as well."""
    NOT_A_WORD = 'not a word'
    """Another sequence of bits, which is no packet, explains them much better."""
    MARGIN = 'margin'
    """A packet of another ID explains them nearly as well."""
    INCOMPLETE = 'incomplete'
    """The packet may not have ended yet."""
    ERASED = 'erased'
    """Too few of its samples are valid."""
    DISTANCE = 'distance'
    """It was read, but no distance was measured."""


REASONS = {
    int(lib.RL_EVIDENCE): Reason.EVIDENCE,
    int(lib.RL_NOT_A_WORD): Reason.NOT_A_WORD,
    int(lib.RL_MARGIN): Reason.MARGIN,
    int(lib.RL_INCOMPLETE): Reason.INCOMPLETE,
    int(lib.RL_ERASED): Reason.ERASED,
}
"""By their numbers in the core."""
