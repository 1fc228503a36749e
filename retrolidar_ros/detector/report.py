# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 6: what is published of a reading: when and where, and how sure."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE
from retrolidar_ros.detector.bearing import shared_bearing
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.judge import Reading
from retrolidar_ros.detector.paper import fit_preamble
from retrolidar_ros.detector.place import Place, place
from retrolidar_ros.detector.ranging import BRIGHT, modulated_range
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import SEPARABLE_M, Floats, ZoneGrid

# The sensor's own step is the least noise that a fit can claim.
_RESOLUTION_SIGNAL = 1 / 2048 / np.sqrt(12)  # [kcps/SPAD]


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
    place = _place(reading, samples, within, grid, size_m)
    if place is None:
        return None
    last = int(np.flatnonzero(within)[-1])
    return Detection(
        id=int(candidate.ids[0]),
        stamp_ns=origin_ns + round(float(samples.time_s[last]) * 1e9),
        start_ns=origin_ns + round(start_s * 1e9),
        place=place,
        snr_db=20 * math.log10(fit.gain[0] / max(fit.deviation[0], _RESOLUTION_SIGNAL)),
        score=float(fit.score[0]),
        likelihood=_likelihood(reading, samples),
        corrected_bits=reading.corrected_bits,
        packets=int(candidate.packets[0]),
        zones=reading.zones,
    )


def _place(
    reading: Reading,
    samples: Samples,
    within: NDArray[np.bool_],
    grid: ZoneGrid,
    size_m: float,
) -> Place | None:
    """Return where the marker of a reading is; None where its distance was not measured.

    Every zone that saw it measures its range; the strongest says how likely the others' shares
    of its light are.
    """
    light = reading.fit.light[0][within]
    told = reading.fit.weight[0][within] > 0
    signal, distance = samples.signal[within], samples.distance[within]
    weight = samples.weight[within] * told[:, None]
    ranges = [
        measured
        for zone in reading.zones
        if (
            measured := modulated_range(
                light, weight[:, zone], signal[:, zone], distance[:, zone], zone, grid
            )
        )
    ]
    if not ranges:
        return None
    range_m, stddev_m = np.array(ranges).T
    surety = stddev_m**-2
    mean_m = float(surety @ range_m / surety.sum())
    view = View.of(samples.at(within), np.arange(grid.zones))
    amplitude, variance = _amplitudes(light, view.weight * told[:, None], view.signal)
    # Where another target is reported when the marker is bright, the marker may be nearly so.
    with np.errstate(invalid='ignore'):
        hidden = np.abs(distance - mean_m * grid.z_per_range) >= SEPARABLE_M
    hidden &= light[:, None] > BRIGHT
    variance += (signal * hidden).sum(axis=0) ** 2 / max(np.count_nonzero(light > BRIGHT), 1) ** 2
    variance[reading.zones[0]] = 0.0
    bearing = shared_bearing(reading.zones[0], amplitude, variance, size_m / mean_m, grid)
    return place(bearing, mean_m, float(surety.sum() ** -0.5))


def _amplitudes(light: Floats, weight: Floats, signal: Floats) -> tuple[Floats, Floats]:
    """Return by how much each zone's signal rises with the light, and the variance of that.

    Parameters
    ----------
    light : array, shape (samples,)
        0 to 1.
    weight, signal : array, shape (samples, zones)
        [kcps/SPAD]
    """
    count = np.maximum(weight.sum(axis=0), 1.0)
    change = (light[:, None] - light @ weight / count) * weight
    energy = np.maximum((change * change).sum(axis=0), 1e-9)
    amplitude = (change * signal).sum(axis=0) / energy
    left = (signal - (signal * weight).sum(axis=0) / count - amplitude * change) * weight
    power = (left * left).sum(axis=0)
    # What is left over may be another marker, whose samples come in pairs and tell half as much.
    alike = np.maximum((left[1:] * left[:-1]).sum(axis=0) / np.maximum(power, 1e-9), 0.0)
    variance = power * (1 + 2 * alike) / np.maximum(count - 2, 1.0)
    return amplitude, np.maximum(variance, _RESOLUTION_SIGNAL**2) / energy


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
