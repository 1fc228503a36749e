# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""IDs that are read where there is no marker."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from evaluation.bench.link import RANGE_M
from evaluation.bench.rates import Frequency, frequency
from retrolidar_ros.detector import Detector
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.scene.reference import SENSOR, walls
from retrolidar_ros.sensor.frame import Recording


def wall_blocks(
    duration_s: float, rng: np.random.Generator, sensor: Sensor = SENSOR
) -> Iterator[Recording]:
    """Yield the frames of a bare wall: white noise."""
    scene = Scene(sensor=sensor, surfaces=walls(RANGE_M, sensor.grid))
    return Simulation(scene, rng).blocks(duration_s)


def false_ids(detector: Detector, blocks: Iterable[Recording], hours: float) -> Frequency:
    """Play a stream without marker, which lasts some sensor-hours, and count what is read."""
    events = sum(len(detector.update_all(block)) for block in blocks)
    return frequency(events, hours)
