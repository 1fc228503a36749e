# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the detection methods cost, side by side in one run.

Run it from the repository's root: `PYTHONPATH=. python3 benchmarks/bench_detector.py`. It prints
for each method and number of zones the time a frame takes when nothing modulates and when three
markers talk, frame by frame and many frames at a time, and the growth of memory over an hour.
"""

from __future__ import annotations

import os

# Threads only get in each other's way in products of this size.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
import resource
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.evaluation.machine import write_figures
from retrolidar_ros.evaluation.reference import SENSOR, marker_in_each_zone
from retrolidar_ros.frame import Recording, ZoneGrid
from retrolidar_ros.scene import Simulation

PERIOD_S = SENSOR.period_s
RANGE_M = 2.0
TALKING = (0, 6, 11)
ZONES = (16, 64, 256, 1024)
FRAMES = 500
REPEATS = 2
HOUR_FRAMES = round(3600 / PERIOD_S)


class WideGrid(ZoneGrid):
    """More zones than the sensor has, for the cost to grow."""

    def __post_init__(self) -> None:
        """Accept any shape."""


def recording(zones: int, talking: int, frames: int) -> Recording:
    """Return frames of a wall, tiled from those of 16 zones, of which some hold a marker."""
    tiles = []
    for tile in range(zones // 16):
        rng = np.random.default_rng(tile)
        scene = marker_in_each_zone(RANGE_M, rng, start_s=(-1.3, 0.0), packets=None)
        markers = tuple(scene.markers[zone] for zone in TALKING[:talking]) if tile == 0 else ()
        tiles.append(Simulation(replace(scene, markers=markers), rng).run(frames * PERIOD_S))
    side = round(zones**0.5)
    grid = ZoneGrid(4, 4) if zones == 16 else WideGrid(side, side)
    first = tiles[0]
    return Recording(
        stamp_ns=first.stamp_ns,
        sequence=first.sequence,
        sensor_time_us=first.sensor_time_us,
        grid=grid,
        distance=np.concatenate([tile.distance for tile in tiles], axis=1),
        signal=np.concatenate([tile.signal for tile in tiles], axis=1),
        ambient=np.concatenate([tile.ambient for tile in tiles], axis=1),
        status=np.concatenate([tile.status for tile in tiles], axis=1),
    )


def microseconds(method: str, frames: Recording, *, at_once: bool) -> float:
    """Return the processor time of a frame [µs], the best of some repeats."""
    taken = []
    for _ in range(REPEATS):
        detector = create_detector(method, frames.grid)
        single = list(frames)
        begin = time.process_time()
        if at_once:
            detector.update_all(frames)
        else:
            for frame in single:
                detector.update(frame)
        taken.append((time.process_time() - begin) / len(frames))
    return 1e6 * min(taken)


def growth_megabytes(method: str) -> float:
    """Return by how much the process grows in the second half of an hour of three markers."""
    block = recording(16, 3, 4 * FRAMES)
    detector = create_detector(method, block.grid)
    length_ns = int(block.stamp_ns[-1]) + round(PERIOD_S * 1e9)
    peaks = []
    for turn in range(HOUR_FRAMES // len(block)):
        detector.update_all(replace(block, stamp_ns=block.stamp_ns + turn * length_ns))
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return peaks[-1] - peaks[len(peaks) // 2]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    arguments = parser.parse_args()
    rows = []
    print('µs a frame: one by one | at once (times real time)')
    for zones in ZONES:
        for talking, name in ((0, 'quiet'), (3, 'three markers')):
            frames = recording(zones, talking, FRAMES)
            for method in METHODS:
                single = microseconds(method, frames, at_once=False)
                many = microseconds(method, frames, at_once=True)
                speed = PERIOD_S / many * 1e6
                print(
                    f'{zones:5d} zones  {name:13s}  {method:5s}  {single:7.0f} | {many:7.0f} '
                    f'({speed:.0f})',
                    flush=True,
                )
                rows.append(
                    {
                        'zones': zones,
                        'talking': talking,
                        'method': method,
                        'frame_us': single,
                        'frame_at_once_us': many,
                        'times_real_time': speed,
                    }
                )
    growth = growth_megabytes(METHODS[0])
    print(f'{METHODS[0]} grows by {growth:.1f} MB in half an hour')
    if arguments.json is not None:
        write_figures(arguments.json, {'rows': rows, 'growth_mb': growth})


if __name__ == '__main__':
    main()
