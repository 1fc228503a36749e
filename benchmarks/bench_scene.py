# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many times faster than real time a scene is simulated.

Run it from the repository's root: `PYTHONPATH=. python3 benchmarks/bench_scene.py`. With 16
zones at least 200 times are wanted; below that the exit code is 1.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace

from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import ZoneGrid

SIMULATED_S = 100.0
REPEATS = 5
WANTED = 200.0


def times_real_time(scene: Scene, simulated_s: float = SIMULATED_S) -> float:
    """Return simulated over elapsed time, the best of some repeats."""
    elapsed_s = []
    for _ in range(REPEATS):
        simulation = Simulation(scene)
        begin_s = time.perf_counter()
        for _ in simulation.blocks(simulated_s):
            pass
        elapsed_s.append(time.perf_counter() - begin_s)
    return simulated_s / min(elapsed_s)


def main() -> int:
    """Print a line for each grid; return the exit code."""
    coffee = load_scene('coffee')
    speeds = []
    for grid in (ZoneGrid(4, 4), ZoneGrid(8, 8)):
        scene = replace(coffee, sensor=replace(coffee.sensor, grid=grid))
        speed = times_real_time(scene)
        frame_us = scene.sensor.period_s / speed * 1e6
        print(f'coffee, {grid.zones} zones: {speed:.0f} times real time, {frame_us:.0f} µs a frame')
        speeds.append(speed)
    return 0 if speeds[0] >= WANTED else 1


if __name__ == '__main__':
    sys.exit(main())
