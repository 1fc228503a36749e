# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What to expect of a marker before it is built: its link, its waking and its battery."""

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from retrolidar_ros.marker.power import THRESHOLD_V, active_share, drawn, voltage_v, wakeup_range_m
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, received_signal
from retrolidar_ros.scene.reference import NOISE, WALL_SIGNAL

SNR = 'c/\N{GREEK SMALL LETTER SIGMA}'
NEEDED_SNR_DB = 8.4  # c over sigma at which the default method reads 80 % of lone packets
SENSOR_REACH_M = 4.0  # to what distance a VL53L8CX measures


def budget(
    *, size_m: float, yaw_rad: float, distance_m: float, cell_mah: float, queries_per_hour: float
) -> dict[str, Any]:
    """Return what to expect of a marker, fit for JSON: three dicts.

    `link` has the signals [kcps/SPAD] before the reference wall, the noise at the mean of both, c
    over sigma (None if nothing comes back), and to what distance 80 % of lone packets are read;
    `wake_up` the photodiode indoors with the paper's threshold, and to what distance it wakes;
    `battery` the mean currents with a packet a query, and how long the cell lasts.
    """
    currents = drawn(active_share(queries_per_hour))
    voltage = float(voltage_v(np.array(distance_m), yaw_rad))
    at_1_m, swing = (
        float(received_signal(np.array(range_m), size_m**2, yaw_rad))
        for range_m in (1.0, distance_m)
    )
    noise = math.sqrt(NOISE.floor + NOISE.slope * (WALL_SIGNAL + swing / 2))
    reach_m = (needed_swing(NEEDED_SNR_DB) / at_1_m) ** (1 / DISTANCE_EXPONENT) if at_1_m else 0.0
    return {
        'link': {
            'bright': WALL_SIGNAL + swing,
            'dark': WALL_SIGNAL,
            'noise': noise,
            'snr_db': 20 * math.log10(swing / noise) if swing else None,
            'reach_m': min(reach_m, SENSOR_REACH_M),
        },
        'wake_up': {
            'voltage_v': voltage,
            'threshold_v': THRESHOLD_V,
            'woken': voltage >= THRESHOLD_V,
            'range_m': wakeup_range_m(angle_rad=yaw_rad),
        },
        'battery': {
            'drawn_ma': asdict(currents),
            'total_ma': currents.total,
            'life_h': cell_mah / currents.total,
        },
    }


def needed_swing(snr_db: float) -> float:
    """Return the signal [kcps/SPAD] between bright and dark that gives a c over sigma [dB].

    The noise is taken at the wall and half of c, so c solves c² = r²·(floor + slope·(wall + c/2))
    with r the wanted ratio.
    """
    power = 10 ** (snr_db / 10)
    linear = NOISE.slope * power / 4
    silent = NOISE.floor + NOISE.slope * WALL_SIGNAL
    return linear + math.sqrt(linear * linear + power * silent)
