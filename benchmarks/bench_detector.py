# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the detector costs: a frame, and a bag from the disk to JSON.

embedded/run python benchmarks/bench_detector.py [--json FILE]

For each scene: the mean and the longest processor time of a frame of the default method, how fast a
bag of it becomes JSON, what a frame costs method `paper`, and how many times as much it costs with
tracks. Then by how much memory grows in half an hour.
"""

from __future__ import annotations

import os

# In products of this size more threads are slower.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
import resource
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time_ns
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.disturbances import restless_blocks
from evaluation.bench.reference_scene import marker_in_each_zone
from evaluation.report.claims import markdown, write_figures
from retrolidar_ros.bag import FrameWriter, read_frames
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.detector.text import to_json
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Recording, ZoneGrid

PERIOD_S = SENSOR.period_s
RANGE_M = 2.0
TALKING = (0, 6, 11)
GRIDS = (ZoneGrid(4, 4), ZoneGrid(8, 8))
FRAMES = 2000  # four times what eight packets take
REPEATS = 2
HALF_HOUR_FRAMES = round(1800 / PERIOD_S)


def recording(grid: ZoneGrid, talking: int, frames: int) -> Recording:
    """Return frames of a wall, tiled from those of 16 zones, of which some hold a marker."""
    tiles = []
    for tile in range(grid.zones // 16):
        rng = np.random.default_rng(tile)
        scene = marker_in_each_zone(RANGE_M, rng, start_s=(-1.3, 0.0))
        markers = tuple(scene.markers[zone] for zone in TALKING[:talking]) if tile == 0 else ()
        tiles.append(Simulation(replace(scene, markers=markers), rng).run(frames * PERIOD_S))
    arrays = {
        name: np.concatenate([getattr(tile, name) for tile in tiles], axis=1)
        for name in ('distance', 'signal', 'ambient', 'status')
    }
    return replace(tiles[0], grid=grid, **arrays)


def frame_times_us(method: str, frames: Recording, *, tracks: bool = False) -> NDArray[np.float64]:
    """Return the processor time of each frame [µs], the best of some repeats."""
    turns = []
    for _ in range(REPEATS):
        detector = create_detector(method, frames.grid)
        stamps = [process_time_ns()]
        for frame in list(frames):
            detector.update(frame)
            if tracks:
                detector.follow(frame)  # type: ignore[attr-defined]
            stamps.append(process_time_ns())
        turns.append(1e-3 * np.diff(stamps))
    # What else the machine does makes a frame longer and never shorter.
    best: NDArray[np.float64] = np.min(turns, axis=0)
    return best


def bag_seconds(frames: Recording) -> float:
    """Return the processor time from a bag on disk to lines of JSON [s], the best of repeats."""
    with TemporaryDirectory() as text:
        path, taken = Path(text) / 'bag', []
        with FrameWriter(path) as writer:
            for frame in frames:
                writer.write(frame)
        for _ in range(REPEATS):
            began_ns = process_time_ns()
            for detection in Decoding(defaults()).detect(read_frames(path)):
                to_json(detection)
            taken.append(1e-9 * (process_time_ns() - began_ns))
    return min(taken)


def growth_megabytes(method: str) -> float:
    """Return by how much the process grows in the second half of half an hour of three markers."""
    block = recording(GRIDS[0], len(TALKING), FRAMES)
    detector = create_detector(method, block.grid)
    length_ns = int(block.stamp_ns[-1]) + round(PERIOD_S * 1e9)
    peaks = []
    for turn in range(HALF_HOUR_FRAMES // len(block)):
        detector.update_all(replace(block, stamp_ns=block.stamp_ns + turn * length_ns))
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return peaks[-1] - peaks[len(peaks) // 2]


def cases() -> Iterator[tuple[str, Recording]]:
    """Yield what the detector is given, by name."""
    for grid in GRIDS:
        zones = f'{grid.rows}×{grid.columns} zones'
        yield f'{zones}, quiet', recording(grid, 0, FRAMES)
        yield f'{zones}, three markers', recording(grid, len(TALKING), FRAMES)
    hands = restless_blocks(FRAMES * PERIOD_S, np.random.default_rng(1))
    yield '4×4 zones, moving hands', next(hands)


def main() -> None:
    """Print a table, and the growth of memory."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    arguments = parser.parse_args()
    default, paper = METHODS
    rows: list[dict[str, Any]] = []
    for name, frames in cases():
        times_us = frame_times_us(default, frames)
        tracks_us = frame_times_us(default, frames, tracks=True)
        row = {
            'case': name,
            'frame_us': times_us.mean(),
            'longest_us': times_us.max(),
            'bag_times_real_time': len(frames) * PERIOD_S / bag_seconds(frames),
            'paper_us': frame_times_us(paper, frames).mean(),
            'tracks_times': tracks_us.mean() / times_us.mean(),
        }
        rows.append(row)
    heads = ['scene', 'µs a frame', 'at most', 'a bag, times real time', 'method `paper`']
    table = [[*heads, 'times with tracks']]
    for row in rows:
        name, *figures, times = row.values()
        table.append([name, *(f'{value:.0f}' for value in figures), f'{times:.2f}'])
    print(markdown(table), flush=True)
    growth = growth_megabytes(default)
    print(f'{default} grows by {growth:.1f} MB in a quarter of an hour')
    if arguments.json is not None:
        write_figures(arguments.json, {'rows': rows, 'growth_mb': growth})


if __name__ == '__main__':
    main()
