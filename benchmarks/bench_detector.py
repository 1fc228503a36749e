# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the detector costs: a frame, and a bag from the disk to JSON.

embedded/run python benchmarks/bench_detector.py [--json FILE]

For each scene: the mean and the longest processor time of a frame of the default method, and how
fast a bag of it becomes JSON.
"""

from __future__ import annotations

import os

# In products of this size more threads are slower.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time_ns

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.disturbances import restless_blocks
from evaluation.bench.recordings import dark, record_at
from evaluation.bench.room_families import pausing, ten_packets
from evaluation.bench.room_scene import Room, RoomSimulation
from evaluation.report.claims import markdown, write_figures
from retrolidar_ros.bag import FrameWriter, read_frames
from retrolidar_ros.cli.decode import to_json
from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.marker.code import RESERVED_IDS
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Recording, ZoneGrid

PERIOD_S = SENSOR.period_s
RANGE_M = 2.0
SIGNAL = 150.0  # [kcps/SPAD]
TALKING = (0, 6, 11)
GRIDS = (ZoneGrid(4, 4), ZoneGrid(8, 8))
FRAMES = 2000  # four times what eight packets take
REPEATS = 6


def recording(grid: ZoneGrid, talking: int) -> Recording:
    """Return frames of a wall, tiled from those of 16 zones, of which some hold a marker."""
    tiles = []
    for tile in range(grid.zones // 16):
        rng = np.random.default_rng(tile)
        sent = record_at(RANGE_M, rng, repeated_s=FRAMES * PERIOD_S)
        markers = TALKING[:talking] if tile == 0 else ()
        silent = np.isin(np.arange(len(sent.ids)), markers, invert=True)
        tiles.append(dark(sent, silent, rng).recording)
    arrays = {
        name: np.concatenate([getattr(tile, name) for tile in tiles], axis=1)
        for name in ('distance', 'signal', 'ambient', 'status')
    }
    return replace(tiles[0], grid=grid, **arrays)


def seen(room: Room, rng: np.random.Generator) -> Recording:
    """Return the frames of a room."""
    return RoomSimulation(room, rng).run(room.scene.duration_s)


def frame_times_us(frames: Recording) -> NDArray[np.float64]:
    """Return the processor time of each frame [µs], the best of some repeats."""
    turns = []
    for _ in range(REPEATS):
        detector = create_detector('joint', frames.grid)
        stamps = [process_time_ns()]
        for frame in list(frames):
            detector.update(frame)
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


def cases() -> Iterator[tuple[str, Recording]]:
    """Yield what the detector is given, by name."""
    for grid in GRIDS:
        zones = f'{grid.rows}×{grid.columns} zones'
        yield f'{zones}, quiet', recording(grid, 0)
        yield f'{zones}, three markers', recording(grid, len(TALKING))
    rng = np.random.default_rng(1)
    yield '4×4 zones, moving hands', next(restless_blocks(FRAMES * PERIOD_S, rng))
    yield '4×4 zones, ever other IDs in each', seen(ten_packets(SIGNAL, rng), rng)
    yield '4×4 zones, a marker without an ID', seen(pausing(RESERVED_IDS[0], 0, rng), rng)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    arguments = parser.parse_args()
    rows = []
    for name, frames in cases():
        times_us = frame_times_us(frames)
        row = {
            'case': name,
            'frame_us': times_us.mean(),
            'longest_us': times_us.max(),
            'bag_times_real_time': len(frames) * PERIOD_S / bag_seconds(frames),
        }
        rows.append(row)
    table = [['scene', 'µs a frame', 'at most', 'a bag, times real time']]
    for name, *figures in map(dict.values, rows):
        table.append([name, *(f'{value:.0f}' for value in figures)])
    print(markdown(table), flush=True)
    if arguments.json is not None:
        write_figures(arguments.json, {'rows': rows})


if __name__ == '__main__':
    main()
