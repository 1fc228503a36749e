# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 7: what is published of a reading: when and where, and how sure."""

from __future__ import annotations

import math

import numpy as np

from retrolidar_ros.code import PACKET_BITS, PREAMBLE
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.judge import Reading
from retrolidar_ros.detector.paper import fit_preamble
from retrolidar_ros.detector.placement import SIGNAL_RESOLUTION, placement
from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import ZoneGrid


def detection_of(
    reading: Reading, samples: Samples, origin_ns: int, grid: ZoneGrid, size_m: float
) -> Detection | None:
    """Return a reading as a detection; None where the marker's distance was not measured.

    Parameters
    ----------
    reading : Reading
    samples : Samples
        Those that it was read from.
    origin_ns : int
        From which their times count [ns].
    grid : ZoneGrid
        The zones.
    size_m : float
        Edge of the marker [m].
    """
    candidate, fit = reading.candidate, reading.fit
    start_s, bit_s = float(fit.start_s[0]), float(fit.bit_s[0])
    end_s = float(candidate.end_s[0]) if candidate.repeats[0] else start_s + PACKET_BITS * bit_s
    within = (samples.end_s > start_s) & (samples.begin_s < end_s)
    place = placement(reading, samples, within, grid, size_m)
    if place is None:
        return None
    last = int(np.flatnonzero(within)[-1])
    return Detection(
        id=int(candidate.ids[0]),
        stamp_ns=origin_ns + round(float(samples.time_s[last]) * 1e9),
        start_ns=origin_ns + round(start_s * 1e9),
        place=place,
        snr_db=20 * math.log10(fit.gain[0] / max(fit.deviation[0], SIGNAL_RESOLUTION)),
        score=float(fit.score[0]),
        likelihood=_likelihood(reading, samples),
        corrected_bits=reading.corrected_bits,
        packets=int(candidate.packets[0]),
        zones=reading.zones,
    )


def _likelihood(reading: Reading, samples: Samples) -> float:
    """Return the paper's l of the first preamble in the window."""
    fit = reading.fit
    start_s, bit_s = float(fit.start_s[0]), float(fit.bit_s[0])
    if reading.candidate.repeats[0] and start_s < reading.candidate.begin_s[0]:
        start_s += PACKET_BITS * bit_s
    since = samples.time_s - start_s
    rows = (since > 0) & (since < len(PREAMBLE) * bit_s) & (fit.weight[0] > 0)
    signal = samples.signal[rows][:, reading.zones[:1]]
    bright = fit.dark + fit.gain
    return float(fit_preamble(signal, bright, 1.0 - fit.light[0][rows]).likelihood[0])
