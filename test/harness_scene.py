# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A simulated marker in the middle of a zone, and a wall."""

from dataclasses import replace

from retrolidar_ros.marker.code import packet
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Ranging, Sensor, Surface
from retrolidar_ros.sensor.frame import Recording, ZoneGrid

GRID = ZoneGrid(4, 4)
ZONE = 10
CENTRE = GRID.directions[ZONE]
NOISE = Noise(floor=4.6, slope=0.22)
RANGING = Ranging(shot=0.49, floor=0.0016)
MARKER = Marker(
    id=2061,
    position_m=(float(CENTRE[0]), float(CENTRE[1]), float(CENTRE[2])),
    name='m',
    response=Response(dark_s=0.5e-3, bright_s=3.5e-3),
)
# A bit and a frame of equal middles: each frame sees one half of a bit.
BITS = packet(2061)
# Bright for ever: its only packet begins after all that the tests look at.
BRIGHT = replace(MARKER, start_s=1e6)


def simulate(scene: Scene, frames: int) -> Recording:
    return Simulation(scene).advance(frames)


def wall(distance_m: float, signal: float, sensor: Sensor | None = None) -> Scene:
    return Scene(sensor=sensor or Sensor(), surfaces=(Surface(distance_m, signal),))
