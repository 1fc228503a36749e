# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Timing of frames: period, jitter, losses; and the statuses of their samples."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.tasks.calibration.estimate import Estimate

MIN_FRAMES = 64


class Timing(NamedTuple):
    """Of the frames of a recording."""

    frames: int
    duration_s: float
    period_s: Estimate
    jitter_s: Estimate
    """Standard deviation of a frame's time."""
    lost: Estimate
    """Share of the frames."""
    longest_gap_s: float
    statuses: dict[int, float]
    """Share of all samples, by status, the most frequent first."""


def timing(recording: Recording) -> Timing:
    """Return how the frames of a recording came.

    Raises
    ------
    ValueError
        If there are too few.
    """
    if len(recording) < MIN_FRAMES:
        raise ValueError(
            f'{len(recording)} frames are too few to calibrate from: record {MIN_FRAMES} at '
            'least, and half a minute for all there is'
        )
    time_s = (recording.stamp_ns - recording.stamp_ns[0]) * 1e-9
    step_s = np.diff(time_s)
    if not (step_s > 0).all():
        raise ValueError('the stamps of the frames do not rise: was the clock set while recording?')
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(step_s / np.median(step_s)), 1))])
    centred = number - number.mean()
    energy = float(centred @ centred)
    period_s = float(centred @ time_s) / energy
    late_s = time_s - time_s.mean() - period_s * centred
    jitter_s = float(np.sqrt(late_s @ late_s / (len(time_s) - 2)))
    frames, expected = len(time_s), int(number[-1]) + 1
    lost = (expected - frames) / expected
    codes, counts = np.unique(recording.status, return_counts=True)
    order = np.argsort(-counts)
    return Timing(
        frames=frames,
        duration_s=float(time_s[-1]),
        period_s=Estimate(period_s, jitter_s / math.sqrt(energy)),
        jitter_s=Estimate(jitter_s, jitter_s / math.sqrt(2 * frames)),
        # Agresti and Coull, 1998: never quite sure, even of none.
        lost=Estimate(lost, math.sqrt((lost * (1 - lost) + 1 / expected) / expected)),
        longest_gap_s=float(step_s.max()),
        statuses={
            int(code): float(count / recording.status.size)
            for code, count in zip(codes[order], counts[order], strict=True)
        },
    )
