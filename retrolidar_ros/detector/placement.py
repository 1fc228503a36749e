# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A reading as the core has placed it."""

import math
from typing import Any

import numpy as np

from retrolidar_ros.core import ffi, lib
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.place import Bearing, place
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import SensorModel


def core_sensor(sensor: SensorModel, grid: ZoneGrid) -> Any:
    """Return the core's struct of a sensor with these zones."""
    meaning = np.full(256, lib.RL_INVALID)
    meaning[list(sensor.valid)] = lib.RL_VALID
    meaning[list(sensor.nothing)] = lib.RL_NOTHING
    meaning[list(sensor.faint)] = lib.RL_FAINT
    fields: dict[str, Any] = {
        'rows': grid.rows,
        'columns': grid.columns,
        'zone_pitch': grid.pitch,
        'z_per_range': grid.z_per_range.tolist(),
        'noise_floor': sensor.noise.floor,
        'noise_slope': sensor.noise.slope,
        'noise_ambient': sensor.noise.ambient,
        'meaning': meaning.tolist(),
    }
    alike = (
        *('zone_blur', 'range_offset_m', 'exposure', 'ranging_shot', 'ranging_floor_m'),
        *('signal_step', 'low_signal', 'max_signal'),
        *('distance_step_m', 'max_distance_m', 'separable_m'),
    )
    fields.update({name: getattr(sensor, name) for name in alike})
    return ffi.new('struct rl_sensor *', fields)


def detection_of(reading: Any, origin_ns: int, grid: ZoneGrid, sensor: SensorModel) -> Detection:
    """Return a reading that is placed, whose times are since an origin."""
    where = reading.placement
    zones = tuple(where.zone[0 : where.zones])
    seen, pitch = where.bearing, grid.pitch
    bearing = Bearing(
        grid.tangents[zones[0]] + pitch * np.array(list(seen.mean)),
        pitch**2 * np.array(list(seen.variance)),
    )
    # No residual is below the quantisation noise.
    amplitude = max(where.amplitude, sensor.signal_step / math.sqrt(12))
    return Detection(
        id=reading.id,
        stamp_ns=origin_ns + round(where.time_s * 1e9),
        start_ns=origin_ns + round(reading.start_s * 1e9),
        end_ns=where.end_ns,
        place=place(bearing, where.range_m, math.sqrt(where.range_variance)),
        snr_db=20 * math.log10(amplitude / math.sqrt(where.noise)),
        evidence=reading.evidence,
        decision_margin=reading.margin,
        bit_period_s=reading.bit_s,
        score=where.score,
        likelihood=where.likelihood,
        corrected_bits=where.corrected_bits,
        packets=reading.packets,
        zones=zones,
    )
