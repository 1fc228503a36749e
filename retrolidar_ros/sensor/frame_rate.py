# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether frames come as a detector needs them: none left out, and two or more in every bit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

RATE_FRAMES = 33
"""Number of frames whose median interval is taken for the frame period."""
_COUNTER = 2**32
_FRAMES_A_BIT = (1.9, 9.0)
_JUDGED_FRAMES = 10
_LEAST_PERIOD_NS = 1_000_000


def missing_frames(before: int | None, after: int) -> int:
    """Return how many frames are missing between two that came one after the other.

    Parameters
    ----------
    before, after : int
        Their 32-bit sequence counters; None before the first frame. A counter that went back is a
        sensor that restarted.
    """
    if before is None:
        return 0
    missing = (after - before - 1) % _COUNTER
    return missing if missing < _COUNTER // 2 else 0


def stamps_stand(frames: int, advance_ns: int) -> bool:
    """Return whether the stamps of so many frames, which advanced by so much, stand still."""
    return frames >= _JUDGED_FRAMES and abs(advance_ns) < frames * _LEAST_PERIOD_NS


def rate_mismatch(stamps_ns: Sequence[int], bit_period_s: float) -> str:
    """Say if a bit does not last two to eight frames, or nearly so; empty if it does.

    Parameters
    ----------
    stamps_ns : sequence of int
        Of successive frames [ns]: of `RATE_FRAMES`, as some may be lost.
    bit_period_s : float
        How long a marker holds a bit [s].
    """
    period_s = float(np.median(np.diff(stamps_ns))) * 1e-9
    least, most = _FRAMES_A_BIT
    if least <= bit_period_s / period_s <= most:
        return ''
    return (
        f'a frame comes every {period_s * 1e3:.1f} ms, but bit_period is '
        f'{bit_period_s * 1e3:.1f} ms: {bit_period_s / period_s:.1f} frames, and not two to eight'
    )
