# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a reading of the core to a detection: stamp and place, from the samples of all zones."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.core import ffi, lib
from retrolidar_ros.detector.bearing import shared_bearing
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.paper import fit_preamble
from retrolidar_ros.detector.place import place
from retrolidar_ros.detector.ranging import BRIGHT, modulated_range
from retrolidar_ros.marker.code import PACKET_BITS, PREAMBLE, packet
from retrolidar_ros.sensor.frame import SEPARABLE_M, Floats, ZoneGrid

NO_FRAME = np.iinfo(np.int64).min
SIGNAL_RESOLUTION = 1 / 2048 / math.sqrt(12)
"""Lower bound of a residual: the quantisation noise of the sensor [kcps/SPAD]."""

NEAREST_M = 1e-3  # that a range is taken to be, whatever its offset
# Minimum share of an exposure within the packet.
_LEAST_INSIDE = 0.25


class Optics(NamedTuple):
    """Where a sensor departs from the usual one."""

    range_offset_m: float = 0.0
    """By how much it measures all ranges too long [m]."""
    zone_pitch: float | None = None
    """Width of a zone as a tangent; None = the usual one."""
    zone_blur: float | None = None
    """Standard deviation of its blur in widths of a zone; None = not known."""


USUAL = Optics()


class Window(NamedTuple):
    """The samples that a packet was read from, oldest first."""

    time_s: Floats
    """Middle of each exposure since the origin of the core's times [s], shape (samples,)."""
    stamp_ns: NDArray[np.int64]
    """Of each frame [ns], `NO_FRAME` where none came, shape (samples,)."""
    light: Floats
    """How bright the marker was, 0 to 1, shape (samples,)."""
    signal: Floats
    """Of the target that may be a marker [kcps/SPAD], shape (samples, zones)."""
    valid: NDArray[np.bool_]
    """Which are valid, shape (samples, zones)."""
    measured: Floats
    """Signal as it was measured, whatever the target [kcps/SPAD], shape (samples, zones)."""
    distance: Floats
    """[m], NaN where none was measured, shape (samples, zones)."""

    @classmethod
    def of(cls, core: Any, held: Any, reading: Any) -> Window:
        """Return the samples of a reading, from those in the core."""
        begin_s = _array(held.begin_s, np.float64, held.count)
        end_s = _array(held.end_s, np.float64, held.count)
        # An exposure mostly outside may show the packet before or after.
        most_s = _LEAST_INSIDE * held.period_s
        first = int(np.searchsorted(end_s, reading.begin_s + most_s, side='right'))
        last = int(np.searchsorted(begin_s, reading.end_s - most_s))
        count, zones = last - first, held.zones
        rows = slice(first, last)
        light = np.empty(count)
        signal = np.empty((zones, count), dtype=np.float32)
        valid = np.empty((zones, count), dtype=np.uint8)
        single = ffi.new('struct rl_reading *', reading)
        lib.rl_detector_light(core, single, first, count, ffi.from_buffer('double[]', light))
        lib.rl_detector_columns(
            core,
            first,
            count,
            ffi.from_buffer('float[]', signal),
            ffi.from_buffer('uint8_t[]', valid),
        )
        shape = (zones, held.capacity)
        measured = _array(held.signal, np.float32, math.prod(shape)).reshape(shape)[:, rows]
        distance = _array(held.distance, np.float32, math.prod(shape)).reshape(shape)[:, rows]
        return cls(
            time_s=(begin_s[rows] + end_s[rows]) / 2,
            stamp_ns=_array(held.stamp_ns + first, np.int64, count),
            light=light,
            signal=signal.T.astype(np.float64),
            valid=valid.T.astype(bool),
            measured=measured.T.astype(np.float64),
            distance=distance.T.astype(np.float64),
        )


def _array(pointer: Any, dtype: Any, count: int) -> NDArray[Any]:
    """Return memory of the core as an array that lives as long as the next frame."""
    return np.frombuffer(ffi.buffer(pointer, count * np.dtype(dtype).itemsize), dtype=dtype)


def detection_of(
    reading: Any,
    window: Window,
    origin_ns: int,
    grid: ZoneGrid,
    size_m: float,
    optics: Optics = USUAL,
) -> Detection | None:
    """Return a reading as a detection; None where the marker's distance was not measured.

    Every zone that has read it contributes to the range, all around the strongest to the bearing.

    Parameters
    ----------
    reading : struct rl_reading
        Of the core.
    window : Window
        Its samples.
    origin_ns : int
        Origin of the core's times [ns].
    grid : ZoneGrid
        The zones.
    size_m : float
        Edge of the marker [m].
    optics : Optics
        Of the sensor.
    """
    if optics.zone_pitch is not None:
        grid = replace(grid, view=optics.zone_pitch * grid.columns)
    amplitude, variance, noise = amplitudes(window.light, window.valid, window.signal)
    zones = _zones_of(reading, amplitude, variance)
    ranges = [
        measured
        for zone in zones
        if (
            measured := modulated_range(
                window.time_s,
                window.light,
                window.valid[:, zone].astype(np.float64),
                window.measured[:, zone],
                window.distance[:, zone],
                zone,
                grid,
            )
        )
    ]
    if not ranges:
        return None
    range_m, stddev_m, time_s = np.array(ranges).T
    surety = stddev_m**-2
    measured_m = float(surety @ range_m / surety.sum())
    mean_m = max(measured_m - optics.range_offset_m, NEAREST_M)
    strongest = zones[0]
    bright = window.light > BRIGHT
    # Where another target is reported while the marker is bright, the marker may be nearly so.
    with np.errstate(invalid='ignore'):
        hidden = np.abs(window.distance - measured_m * grid.z_per_range) >= SEPARABLE_M
    variance += (window.measured[bright] * hidden[bright]).mean(axis=0) ** 2
    variance[strongest] = 0.0
    bearing = shared_bearing(
        strongest, amplitude, variance, size_m / mean_m, grid, optics.zone_blur
    )
    stamp_s = float(surety @ time_s / surety.sum())
    snr = max(float(amplitude[strongest]), SIGNAL_RESOLUTION) / math.sqrt(noise[strongest])
    return Detection(
        id=reading.id,
        stamp_ns=origin_ns + round(stamp_s * 1e9),
        start_ns=origin_ns + round(reading.start_s * 1e9),
        end_ns=int(window.stamp_ns[window.stamp_ns != NO_FRAME][-1]),
        place=place(bearing, mean_m, float(surety.sum() ** -0.5)),
        snr_db=20 * math.log10(snr),
        evidence=reading.evidence,
        decision_margin=reading.margin,
        bit_period_s=reading.bit_s,
        score=_score(window, strongest),
        likelihood=_likelihood(reading, window, strongest),
        corrected_bits=_corrected_bits(reading, window, strongest),
        packets=reading.packets,
        zones=tuple(zones),
    )


def _zones_of(reading: Any, amplitude: Floats, variance: Floats) -> list[int]:
    """Return the zones with a significant amplitude, strongest first."""
    zones = [reading.zone[index] for index in range(reading.zones)]
    strongest = max(zones, key=lambda zone: float(amplitude[zone]))
    sure = [
        zone
        for zone in zones
        if zone == strongest or amplitude[zone] > 3 * math.sqrt(float(variance[zone]))
    ]
    return sorted(sure, key=lambda zone: -float(amplitude[zone]))


def amplitudes(
    light: Floats, valid: NDArray[np.bool_], signal: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the amplitude of each zone's signal over the light, its variance, and the noise.

    The noise is the variance of the residual.

    Parameters
    ----------
    light : array, shape (samples,)
        0 to 1.
    valid, signal : array, shape (samples, zones)
        [kcps/SPAD]
    """
    count = np.maximum(valid.sum(axis=0), 1.0)
    change = (light[:, None] - light @ valid / count) * valid
    energy = np.maximum((change * change).sum(axis=0), 1e-9)
    amplitude = (change * signal).sum(axis=0) / energy
    left = (signal - (signal * valid).sum(axis=0) / count - amplitude * change) * valid
    power = (left * left).sum(axis=0)
    # The residual may be another marker, whose samples come in pairs and count half.
    alike = np.maximum((left[1:] * left[:-1]).sum(axis=0) / np.maximum(power, 1e-9), 0.0)
    noise = np.maximum(power / np.maximum(count - 2, 1.0), SIGNAL_RESOLUTION**2)
    return amplitude, noise * (1 + 2 * alike) / energy, noise


def _score(window: Window, zone: int) -> float:
    """Return the correlation of a zone's samples with the light of the packet, 0 to 1."""
    valid = window.valid[:, zone]
    light = window.light[valid] - window.light[valid].mean()
    signal = window.signal[valid, zone] - window.signal[valid, zone].mean()
    power = float(light @ light) * float(signal @ signal)
    return max(float(light @ signal) / math.sqrt(power), 0.0) if power > 0 else 0.0


def _likelihood(reading: Any, window: Window, zone: int) -> float:
    """Return the paper's l of the first whole preamble in the window."""
    start_s = reading.start_s
    if start_s < reading.begin_s:
        start_s += PACKET_BITS * reading.bit_s
    since = window.time_s - start_s
    rows = (since > 0) & (since < len(PREAMBLE) * reading.bit_s) & window.valid[:, zone]
    signal = window.signal[rows, zone][:, None]
    bright = window.light > BRIGHT
    level = float(window.signal[bright, zone].mean()) if bright.any() else 0.0
    return float(fit_preamble(signal, np.array([level]), 1.0 - window.light[rows]).likelihood[0])


def _corrected_bits(reading: Any, window: Window, zone: int) -> int:
    """Return how many bits of the last packet are wrong in a hard decision."""
    valid = window.valid[:, zone]
    bit = np.floor((window.time_s[valid] - reading.start_s) / reading.bit_s).astype(np.intp)
    last = bit > bit[-1] - PACKET_BITS
    bit = bit[last] % PACKET_BITS
    signal = window.signal[valid, zone][last]
    count = np.bincount(bit, minlength=PACKET_BITS)
    known = count > 0
    mean = np.bincount(bit, signal, minlength=PACKET_BITS)[known] / count[known]
    dark = packet(reading.id)[known] == 1
    if not (dark.any() and (~dark).any()):
        return 0
    middle = (mean[dark].mean() + mean[~dark].mean()) / 2
    return int(np.count_nonzero((mean < middle) != dark))
