# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detection methods by name."""

import math

from numpy.typing import ArrayLike

from retrolidar_ros.detector.budget import USUAL_FALSE_IDS_PER_HOUR
from retrolidar_ros.detector.detection import Detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector, usable_ids
from retrolidar_ros.detector.paper_detector import LIKELIHOOD_THRESHOLD, PaperDetector
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, SensorModel

MAX_PACKETS = 8
METHODS = ('joint', 'paper')  # the default first


def create_detector(
    method: str,
    grid: ZoneGrid,
    *,
    bit_period_s: float = BIT_PERIOD_S,
    likelihood_threshold: float = LIKELIHOOD_THRESHOLD,
    false_ids_per_hour: float = USUAL_FALSE_IDS_PER_HOUR,
    max_packets: int = MAX_PACKETS,
    registered_ids: ArrayLike | None = None,
    sensor: SensorModel = VL53L8CX,
) -> Detector:
    """Return a new detector; ValueError if there is no such method, or a parameter is impossible.

    Parameters
    ----------
    method : str
        One of `METHODS`.
    grid : ZoneGrid
        The zones of the frames.
    bit_period_s : float
        How long a marker holds a bit [s].
    likelihood_threshold : float
        Minimum likelihood l of a preamble (method `paper`).
    false_ids_per_hour : float
        Budget of false IDs per hour, over all zones (method `joint`).
    max_packets : int
        How many packets of a repeating marker may be combined, 1 to 8 (method `joint`).
    registered_ids : array of int, optional
        The only IDs that are read. With fewer IDs, method `joint` reads farther; `paper` drops
        others after decoding, and its reach stays the same.
    sensor : SensorModel
        Noise, optics and limits of the sensor (method `joint`).
    """
    if method not in METHODS:
        raise ValueError(f'unknown method {method!r}; there is {", ".join(METHODS)}')
    for name, value in (
        ('bit_period', bit_period_s),
        ('likelihood_threshold', likelihood_threshold),
        ('false_ids_per_hour', false_ids_per_hour),
    ):
        if not 0 < value < math.inf:
            raise ValueError(f'{name} of {value}: it must be positive and finite')
    if not 1 <= max_packets <= MAX_PACKETS:
        raise ValueError(f'max_packets of {max_packets}: it must be 1 to {MAX_PACKETS}')
    if method == 'paper':
        return PaperDetector(
            grid,
            bit_period_s=bit_period_s,
            likelihood_threshold=likelihood_threshold,
            registered_ids=usable_ids(registered_ids),
        )
    return LikelihoodDetector(
        grid,
        bit_period_s=bit_period_s,
        false_ids_per_hour=false_ids_per_hour,
        max_packets=max_packets,
        registered_ids=registered_ids,
        sensor=sensor,
    )
