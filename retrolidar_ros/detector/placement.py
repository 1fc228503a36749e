# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the core says of a marker's place: of a reading as a detection, and of samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from retrolidar_ros.core import array, ffi, lib
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.place import Bearing, place
from retrolidar_ros.sensor.frame import Floats, ZoneGrid

SIGNAL_RESOLUTION = 1 / 2048 / math.sqrt(12)
"""Lower bound of a residual: the quantisation noise of the sensor [kcps/SPAD]."""


class Optics(NamedTuple):
    """Where a sensor departs from the usual one."""

    range_offset_m: float = 0.0
    """By how much it measures all ranges too long [m]."""
    zone_pitch: float | None = None
    """Width of a zone as a tangent; None = the usual one."""
    zone_blur: float | None = None
    """Standard deviation of its blur in widths of a zone; None = not known."""


class Placer:
    """Places readings of a core."""

    def __init__(self, core: Any, grid: ZoneGrid, optics: Optics) -> None:
        """Prepare for frames of `grid`."""
        if optics.zone_pitch is not None:
            grid = replace(grid, view=optics.zone_pitch * grid.columns)
        self._core = core
        self.grid = grid
        self._z_per_range = array('double', grid.z_per_range)
        self._optics = ffi.new('struct rl_optics *')
        self._optics.z_per_range = self._z_per_range
        self._optics.range_offset_m = optics.range_offset_m
        self._optics.blur = optics.zone_blur or 0.0
        self._placement = ffi.new('struct rl_placement *')

    def place(self, index: int, origin_ns: int, size_m: float) -> Detection | None:
        """Return a reading of the newest frame; None where no distance was measured.

        The core's times count from `origin_ns`; the marker has edges of `size_m`.
        """
        reading = ffi.new('struct rl_reading *', lib.rl_detector_reading(self._core, index))
        placed, pitch = self._placement, self.grid.pitch
        self._optics.width_m = size_m / pitch
        if not lib.rl_place(self._core, reading, self._optics, placed):
            return None
        zones = tuple(placed.zone[0 : placed.zones])
        seen = placed.bearing
        bearing = Bearing(
            self.grid.tangents[zones[0]] + pitch * np.array(list(seen.mean)),
            pitch**2 * np.array(list(seen.variance)),
        )
        return Detection(
            id=reading.id,
            stamp_ns=origin_ns + round(placed.time_s * 1e9),
            start_ns=origin_ns + round(reading.start_s * 1e9),
            end_ns=placed.end_ns,
            place=place(bearing, placed.range_m, math.sqrt(placed.range_variance)),
            snr_db=20
            * math.log10(max(placed.amplitude, SIGNAL_RESOLUTION) / math.sqrt(placed.noise)),
            evidence=reading.evidence,
            decision_margin=reading.margin,
            bit_period_s=reading.bit_s,
            score=placed.score,
            likelihood=placed.likelihood,
            corrected_bits=placed.corrected_bits,
            packets=reading.packets,
            zones=zones,
        )


class Depth(NamedTuple):
    """Of a marker, along the optical axis."""

    depth_m: float
    variance: float
    """[m²]"""
    time_s: float
    """When it holds."""


def modulated_depth(
    begin_s: Floats, end_s: Floats, light: Floats, valid: Floats, signal: Floats, distance: Floats
) -> Depth | None:
    """Return how far a marker is, as the core finds it; None without distances.

    Parameters
    ----------
    begin_s, end_s : array, shape (samples,)
        Of each exposure [s].
    light : array, shape (samples,)
        How bright the marker was, 0 to 1.
    valid : array, shape (samples,)
        Which samples are.
    signal : array, shape (samples,)
        [kcps/SPAD]
    distance : array, shape (samples,)
        [m], NaN where there was no target.
    """
    times = {'begin_s': begin_s, 'end_s': end_s, 'light': light}
    held = {name: array('double', values) for name, values in times.items()}
    held['valid'] = array('uint8_t', valid)
    held['signal'], held['distance'] = array('float', signal), array('float', distance)
    rows = len(light)
    seen = ffi.new('struct rl_seen *', {'rows': rows, **held})
    found = ffi.new('struct rl_ranged *')
    if not lib.rl_ranging(seen, ffi.new('float[]', rows), ffi.new('uint8_t[]', rows), found):
        return None
    return Depth(found.depth_m, found.variance, found.time_s)
