# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 6: where the marker of a reading is, from what all zones saw of it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.bearing import shared_bearing
from retrolidar_ros.detector.judge import Reading
from retrolidar_ros.detector.place import Place, place
from retrolidar_ros.detector.ranging import BRIGHT, modulated_range
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.window import Samples
from retrolidar_ros.frame import SEPARABLE_M, Floats, ZoneGrid

SIGNAL_RESOLUTION = 1 / 2048 / np.sqrt(12)
"""The sensor's own step is the least noise that a fit can claim [kcps/SPAD]."""


def placement(
    reading: Reading,
    samples: Samples,
    within: NDArray[np.bool_],
    grid: ZoneGrid,
    size_m: float,
) -> Place | None:
    """Return where the marker of a reading is; None where its distance was not measured.

    Every zone that has read it tells its range, and all zones around the strongest its bearing.

    Parameters
    ----------
    reading : Reading
    samples : Samples
        Those that it was read from.
    within : array of bool, shape (samples,)
        Which of them are of its packets.
    grid : ZoneGrid
        The zones.
    size_m : float
        Edge of the marker [m].
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
    amplitude, variance = amplitudes(light, view.weight * told[:, None], view.signal)
    # Where another target is reported when the marker is bright, the marker may be nearly so.
    with np.errstate(invalid='ignore'):
        hidden = np.abs(distance - mean_m * grid.z_per_range) >= SEPARABLE_M
    bright = light > BRIGHT
    variance += (signal[bright] * hidden[bright]).mean(axis=0) ** 2
    variance[reading.zones[0]] = 0.0
    bearing = shared_bearing(reading.zones[0], amplitude, variance, size_m / mean_m, grid)
    return place(bearing, mean_m, float(surety.sum() ** -0.5))


def amplitudes(light: Floats, weight: Floats, signal: Floats) -> tuple[Floats, Floats]:
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
    return amplitude, np.maximum(variance, SIGNAL_RESOLUTION**2) / energy
