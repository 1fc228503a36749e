# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The reference scene: a marker in the middle of every zone, all at one range.

Each is on a wall, so that marker and wall merge into one pulse; every zone is a reading of its own.
"""

import numpy as np

from retrolidar_ros.marker.code import IDS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.scene.reference import RESPONSE, SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import ZoneGrid


def walls(range_m: float, grid: ZoneGrid, signal: float = WALL_SIGNAL) -> tuple[Surface, ...]:
    """Return a background in every zone at the distance that the sensor reports for a range."""
    return tuple(
        Surface(float(range_m * factor), signal, (zone,))
        for zone, factor in enumerate(grid.z_per_range)
    )


def marker_in_each_zone(
    range_m: float, rng: np.random.Generator, *, start_s: tuple[float, float], size_m: float = 0.03
) -> Scene:
    """Return the reference scene with random usable IDs, one of each a zone, at a radial distance.

    Markers repeat from a random time between both `start_s` on [s].
    """
    grid = SENSOR.grid
    ids = 1 + rng.choice(IDS - 2, grid.zones, replace=False)
    starts = rng.uniform(*start_s, grid.zones)
    markers = tuple(
        Marker(int(id_), tuple(at.tolist()), size_m=size_m, start_s=float(start), response=RESPONSE)
        for id_, start, at in zip(ids, starts, range_m * grid.directions, strict=True)
    )
    return Scene(sensor=SENSOR, markers=markers, surfaces=walls(range_m, grid))
