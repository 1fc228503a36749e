# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether frames come as a detector needs them: none left out, and one or more in every bit."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from retrolidar_ros.sensor.frame import Recording

RATE_FRAMES = 33  # number of frames whose median interval is taken for the frame period
_COUNTER = 2**32
FRAMES_A_BIT = (0.95, 9.0)  # how many frames a bit lasts at least and at most, if it is to be read
_JUDGED_FRAMES = 10
_MIN_PERIOD_NS = 1_000_000


def missing_frames(before: int | None, after: int) -> int:
    """Return how many frames are missing between two 32-bit sequence counters.

    Before the first frame there is None. A counter that went back is a sensor that restarted.
    """
    if before is None:
        return 0
    missing = (after - before - 1) % _COUNTER
    return missing if missing < _COUNTER // 2 else 0


def stamps_stand(frames: int, advance_ns: int) -> bool:
    """Return whether the stamps of so many frames, which advanced by so much, stand still."""
    return frames >= _JUDGED_FRAMES and abs(advance_ns) < frames * _MIN_PERIOD_NS


def frame_period(recording: Recording) -> float:
    """Return the usual time between successive frames [s], of which some may be lost.

    By the later of stamp and sensor's clock: stamps of frames that come late, all at once, are too
    near to each other.
    """
    step_ns = np.maximum(np.diff(recording.stamp_ns), 1000 * np.diff(recording.sensor_time_us))
    numbers = recording.sequence.tolist()
    missing = np.array([missing_frames(*pair) for pair in pairwise(numbers)])
    return float(np.median(step_ns / (1 + missing))) * 1e-9
