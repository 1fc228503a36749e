# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a marker or two, and what detectors read of them."""

from collections.abc import Iterable
from functools import cache

import numpy as np
import pytest

from retrolidar_ros.detector import METHODS, Detection, Detector, create_detector
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Response, Sensor, Surface
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid

# Repeated or alone, this ID shows no second preamble.
ID, OTHER_ID = 2073, 2096
ZONE = 9
GRID = ZoneGrid()

every_method = pytest.mark.parametrize('method', METHODS)


def a_scene(**marker: object) -> Scene:
    """Return a scene with one marker at 1.2 m in the middle of `ZONE`, and a wall behind it."""
    x, y, z = (1.2 * GRID.directions[ZONE]).tolist()
    settings = {'id': ID, 'position_m': (x, y, z), 'name': 'marker', 'start_s': 2.0, 'packets': 1}
    return Scene(
        sensor=Sensor(noise=Noise(floor=4.6, slope=0.22)),
        markers=(
            Marker(**{**settings, 'response': Response(0.0005, 0.0035), **marker}),  # type: ignore[arg-type]
        ),
        surfaces=(Surface(float(1.2 * GRID.z_per_range[ZONE]), 4.0),),
    )


def simulate(scene: Scene, duration_s: float = 4.5, seed: int = 3) -> Recording:
    return Simulation(scene, np.random.default_rng(seed)).run(duration_s)


@cache
def lone() -> Recording:
    """Return the frames of a lone packet."""
    return simulate(a_scene())


@cache
def repeating(duration_s: float) -> Recording:
    """Return the frames of a marker that never pauses."""
    return simulate(a_scene(start_s=0.0, packets=None), duration_s)


def run(frames: Iterable[Frame], detector: Detector | str = 'paper') -> list[Detection]:
    """Give a detector frames one by one; return what it reads."""
    if isinstance(detector, str):
        detector = create_detector(detector, GRID)
    return [detection for frame in frames for detection in detector.update(frame)]


def ids(detections: Iterable[Detection]) -> list[int]:
    return [detection.id for detection in detections]
