# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
# ruff: noqa: E402 - the other core is to be loaded before the package
"""Reads markers of another packet with another sensor: other_packet.py CORE.

CORE is the core and its binding, built with `other_packet.h`; the package runs on it as on its own.
Of every detection one line of JSON says its ID, its range, and when its packet began.
"""

import json
import sys
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_loader

NAME = 'retrolidar_ros._core'
_spec = spec_from_loader(NAME, ExtensionFileLoader(NAME, sys.argv[1]))
assert _spec is not None
assert _spec.loader is not None
sys.modules[NAME] = module_from_spec(_spec)
_spec.loader.exec_module(sys.modules[NAME])

from dataclasses import replace

import numpy as np

from retrolidar_ros.detector import create_detector
from retrolidar_ros.scene.description import Marker, Noise, Ranging, Scene, Sensor, Surface
from retrolidar_ros.scene.reference import RESPONSE
from retrolidar_ros.scene.simulation import Simulation
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, NoiseLaw, SensorModel, Status

BIT_S = 0.133
VALID, MERGED, NOTHING = 0, 1, 2
MODEL = SensorModel(
    field_of_view=0.6,
    noise=NoiseLaw(9.0, 0.3, 0.0),
    ranging_shot=0.6,
    ranging_floor_m=0.002,
    signal_step=1 / 256,
    max_signal=2.0**15,
    distance_step_m=1e-3,
    max_distance_m=4.0,
    separable_m=0.5,
    valid=(VALID, MERGED),
    nothing=(NOTHING,),
    faint=(),
)
GRID = ZoneGrid(8, 8, view=MODEL.field_of_view)
SENDINGS = {(9, 100, 1, 5.0), (27, 311, 1, 6.4), (44, 500, None, 3.0), (62, 7, 1, 7.7)}
"""Zone, ID, packets and start [s] of each marker."""


def main() -> None:
    """Emulate, read and print."""
    markers = tuple(
        Marker(
            id=number,
            position_m=tuple(1.2 * GRID.directions[zone]),
            bit_period_s=BIT_S,
            start_s=start_s,
            packets=packets,
            response=RESPONSE,
        )
        for zone, number, packets, start_s in sorted(SENDINGS)
    )
    sensor = Sensor(
        grid=GRID,
        period_s=1 / 15,
        noise=Noise(MODEL.noise.floor, MODEL.noise.slope),
        ranging=Ranging(MODEL.ranging_shot, MODEL.ranging_floor_m),
    )
    walls = tuple(Surface(float(1.2 * f), 4.0, (z,)) for z, f in enumerate(GRID.z_per_range))
    scene = Scene(sensor=sensor, markers=markers, surfaces=walls)
    recording = Simulation(scene, np.random.default_rng(7)).run(15.0)
    code = np.full(256, 99, np.uint8)
    code[[Status.VALID, Status.MERGED, Status.NO_TARGET]] = VALID, MERGED, NOTHING
    recording = replace(recording, status=code[recording.status])
    for model in (MODEL, VL53L8CX):
        detector = create_detector('joint', GRID, bit_period_s=BIT_S, sensor=model)
        found = [
            [one.id, one.place.range_m, one.start_ns * 1e-9, *one.zones[:1]]
            for one in detector.update_all(recording)
        ]
        print(json.dumps(found))


if __name__ == '__main__':
    main()
