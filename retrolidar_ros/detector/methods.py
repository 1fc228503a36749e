# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detection methods by name, and the thresholds for a budget of false IDs per hour."""

import math
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.detector.detection import Thresholds
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.paper_detector import LIKELIHOOD_THRESHOLD, PaperDetector
from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS, RESERVED_IDS, check_ids
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, SensorModel

MAX_PACKETS = 8
USUAL_FALSE_IDS_PER_HOUR = 0.1
_USUAL_WORDS = IDS - len(RESERVED_IDS)
_USUAL_ZONES = 16
METHODS = ('joint', 'paper')  # the default first
Detector: TypeAlias = LikelihoodDetector | PaperDetector
"""Frames in, detections out; ValueError for frames of another zone grid."""


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

    Only `registered_ids` are read: by `joint` farther if they are fewer; `paper` drops others after
    decoding. Method `paper` takes the minimum likelihood l of a preamble; `joint` the budget of
    false IDs over all zones, how many packets it may combine (1 to 8), and the sensor.
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
    ids = _usable_ids(registered_ids)
    if method == 'paper':
        return PaperDetector(
            grid,
            bit_period_s=bit_period_s,
            likelihood_threshold=likelihood_threshold,
            registered_ids=ids,
        )
    return LikelihoodDetector(
        grid,
        bit_period_s=bit_period_s,
        thresholds=_thresholds(false_ids_per_hour, grid.zones, len(ids), bit_period_s),
        max_packets=max_packets,
        ids=ids,
        sensor=sensor,
    )


def _thresholds(false_ids_per_hour: float, zones: int, words: int, bit_s: float) -> Thresholds:
    """Return the thresholds for a budget over all zones (`evaluation.experiments.roc`)."""
    trials = (zones / _USUAL_ZONES) * (words / _USUAL_WORDS) * (BIT_PERIOD_S / bit_s)
    allowed = false_ids_per_hour / USUAL_FALSE_IDS_PER_HOUR
    lenience = min(max(math.log(allowed), -4.0), 4.0)
    return Thresholds(
        evidence=26.0 + math.log(trials / allowed),
        wandering=6.0,
        word=8.0,
        margin=math.log(1e3) - lenience,
        margin_of_more=math.log(1e4) - lenience,
    )


def _usable_ids(registered_ids: ArrayLike | None) -> NDArray[np.int64]:
    """Return the registered IDs, or all usable ones, ascending; ValueError for other ones."""
    if registered_ids is None:
        return USABLE_IDS
    ids = np.unique(check_ids(registered_ids))
    reserved = np.intersect1d(ids, RESERVED_IDS)
    if len(reserved):
        raise ValueError(
            f'registered_ids holds {reserved[0]}, which no marker sends: 1 to 4094 are IDs'
        )
    if not len(ids):
        raise ValueError('registered_ids holds no ID: leave it out to read all')
    return ids
