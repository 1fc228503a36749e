# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The reference scene: what every experiment starts from.

One 3 cm × 3 cm marker in the middle of every zone, all at the same range, each on a wall of
4 kcps/SPAD (paper §3.2) so that marker and wall merge into one pulse; the signal's variance and
the ranging deviation are those of a VL53L8CX. Every zone is a reading of its own.
"""

from __future__ import annotations

import numpy as np

from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene.description import Marker, Noise, Ranging, Scene, Sensor, Surface
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX

WALL_SIGNAL = 4.0  # [kcps/SPAD]
NOISE = Noise(floor=VL53L8CX.noise.floor, slope=VL53L8CX.noise.slope)
RANGING = Ranging(shot=VL53L8CX.ranging_shot, floor=VL53L8CX.ranging_floor_m)
SENSOR = Sensor(noise=NOISE, ranging=RANGING)
RESPONSE = Response(dark_s=0.0005, bright_s=0.0035)


def walls(range_m: float, grid: ZoneGrid) -> tuple[Surface, ...]:
    """Return a background in every zone at the distance that the sensor reports for a range."""
    return tuple(
        Surface(float(range_m * factor), WALL_SIGNAL, (zone,))
        for zone, factor in enumerate(grid.z_per_range)
    )


def marker_in_each_zone(
    range_m: float,
    rng: np.random.Generator,
    *,
    start_s: tuple[float, float],
    packets: int | None = 1,
    size_m: float = 0.03,
    yaw_rad: float = 0.0,
    sensor: Sensor = SENSOR,
    bit_period_s: float = BIT_PERIOD_S,
) -> Scene:
    """Return the reference scene with random usable IDs, one of each a zone, at a radial distance.

    The first packets start at random between both times `start_s` [s]; None packets are sent
    without end.
    """
    grid = sensor.grid
    ids = 1 + rng.choice(IDS - 2, grid.zones, replace=False)
    starts = rng.uniform(*start_s, grid.zones)
    markers = tuple(
        Marker(
            id=int(identity),
            position_m=(float(place[0]), float(place[1]), float(place[2])),
            name=f'marker_{identity}',
            size_m=size_m,
            yaw_rad=yaw_rad,
            bit_period_s=bit_period_s,
            start_s=float(start),
            packets=packets,
            response=RESPONSE,
        )
        for identity, start, place in zip(ids, starts, range_m * grid.directions, strict=True)
    )
    return Scene(sensor=sensor, markers=markers, surfaces=walls(range_m, grid))
