# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the detection methods cost, and the default one beside an earlier revision, in one run.

Run it from the repository's root: `PYTHONPATH=. python3 benchmarks/bench_detector.py`. It prints
what a frame costs the default method and the one of an earlier revision, in turns over the same
frames, and how fast a bag becomes JSON; for each method and number of zones the time a frame takes
when nothing modulates and when three markers talk, frame by frame and many frames at a time; and
the growth of memory over half an hour.
"""

from __future__ import annotations

import os

# Threads only get in each other's way in products of this size.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
import json
import resource
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import frame_times
import numpy as np

from evaluation.bench.disturbances import restless_blocks
from evaluation.report.claims import markdown, write_figures
from retrolidar_ros.bag import FrameWriter
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.reference import SENSOR, marker_in_each_zone
from retrolidar_ros.sensor.frame import Recording, ZoneGrid

PERIOD_S = SENSOR.period_s
RANGE_M = 2.0
TALKING = (0, 6, 11)
GRIDS = (ZoneGrid(4, 4), ZoneGrid(8, 8))
FRAMES = 1000
REPEATS = 2
HALF_HOUR_FRAMES = round(1800 / PERIOD_S)
BEFORE_THE_CORE = 'f723e5a'
COMPARED_FRAMES = 2000  # four times what eight packets take
ROOT = Path(__file__).parent.parent


def recording(grid: ZoneGrid, talking: int, frames: int) -> Recording:
    """Return frames of a wall, tiled from those of 16 zones, of which some hold a marker."""
    tiles = []
    for tile in range(grid.zones // 16):
        rng = np.random.default_rng(tile)
        scene = marker_in_each_zone(RANGE_M, rng, start_s=(-1.3, 0.0), packets=None)
        markers = tuple(scene.markers[zone] for zone in TALKING[:talking]) if tile == 0 else ()
        tiles.append(Simulation(replace(scene, markers=markers), rng).run(frames * PERIOD_S))
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
    """Return by how much the process grows in the second half of half an hour of three markers."""
    block = recording(GRIDS[0], len(TALKING), 2 * FRAMES)
    detector = create_detector(method, block.grid)
    length_ns = int(block.stamp_ns[-1]) + round(PERIOD_S * 1e9)
    peaks = []
    for turn in range(HALF_HOUR_FRAMES // len(block)):
        detector.update_all(replace(block, stamp_ns=block.stamp_ns + turn * length_ns))
        peaks.append(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)
    return peaks[-1] - peaks[len(peaks) // 2]


def cases() -> Iterator[tuple[str, Recording]]:
    """Yield what both revisions are given, by name."""
    for grid in GRIDS:
        zones = f'{grid.rows}×{grid.columns} zones'
        yield f'{zones}, quiet', recording(grid, 0, COMPARED_FRAMES)
        yield f'{zones}, three markers', recording(grid, len(TALKING), COMPARED_FRAMES)
    hands = restless_blocks(COMPARED_FRAMES * PERIOD_S, np.random.default_rng(1))
    yield '4×4 zones, moving hands', next(hands)


def export(revision: str, directory: Path) -> None:
    """Write the sources of a revision to a directory, and build its core if it has one.

    Raises
    ------
    subprocess.CalledProcessError
        If there is no such revision, or it cannot be built.
    """
    archive = subprocess.run(
        ['git', 'archive', revision], cwd=ROOT, stdout=subprocess.PIPE, check=True
    )
    subprocess.run(['tar', '-x', '-C', str(directory)], input=archive.stdout, check=True)
    if (directory / 'core' / 'binding.py').exists():
        build = [sys.executable, 'setup.py', '-q', 'build_ext', '--inplace']
        subprocess.run(build, cwd=directory, check=True)


def timed(sources: Path | None, saved: list[tuple[Path, Path]]) -> list[dict[str, Any]]:
    """Return what `frame_times` says of recordings and bags, by the sources in a directory.

    None stands for these sources. Raises subprocess.CalledProcessError if it fails.
    """
    environment = dict(os.environ)
    if sources is not None:
        paths = [str(sources), environment.get('PYTHONPATH', '')]
        environment['PYTHONPATH'] = os.pathsep.join(filter(None, paths))
    command = [
        sys.executable,
        frame_times.__file__,
        *(str(path) for pair in saved for path in pair),
    ]
    answer = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True).stdout
    found: list[dict[str, Any]] = json.loads(answer)
    return found


def compared(revision: str) -> list[dict[str, Any]]:
    """Return times of a revision and of these sources, in turns over the same frames."""
    with TemporaryDirectory() as text:
        directory, recordings = Path(text), dict(cases())
        sources = {'old': directory / 'old', 'new': None}
        (directory / 'old').mkdir()
        export(revision, directory / 'old')
        saved = []
        for number, frames in enumerate(recordings.values()):
            saved.append((directory / f'{number}.npz', directory / f'{number}'))
            frame_times.save(saved[-1][0], frames)
            with FrameWriter(saved[-1][1]) as writer:
                for frame in frames:
                    writer.write(frame)
        turns = [{age: timed(of, saved) for age, of in sources.items()} for _ in range(REPEATS)]
    rows = []
    for number, (name, frames) in enumerate(recordings.items()):
        row: dict[str, Any] = {'case': name}
        for age in sources:
            of = [turn[age][number] for turn in turns]
            # What else the machine does makes a frame longer and never shorter.
            row[age] = {
                'frame_us': 1e-3 * min(sum(one['frames_ns']) for one in of) / len(frames),
                'longest_us': 1e-3 * np.min([one['frames_ns'] for one in of], axis=0).max(),
                'bag_times_real_time': len(frames) * PERIOD_S / min(one['bag_s'] for one in of),
            }
        rows.append(row)
    return rows


def against_table(against: dict[str, Any]) -> str:
    """Return what frames cost an earlier revision and this one."""
    rows = [['method `joint`', f'revision {against["revision"]}', 'now', 'times better']]
    for row in against['rows']:
        old, new = row['old'], row['new']
        for key, what in (
            ('frame_us', 'processor time of a frame [µs]'),
            ('longest_us', 'longest frame [µs]'),
            ('bag_times_real_time', 'from a bag to JSON [times real time]'),
        ):
            better = new[key] / old[key] if key == 'bag_times_real_time' else old[key] / new[key]
            cells = (f'{old[key]:.0f}', f'{new[key]:.0f}', f'{better:.1f}')
            rows.append([f'{row["case"]}: {what}', *cells])
    return markdown(rows)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    parser.add_argument(
        '--against', metavar='REV', default=BEFORE_THE_CORE, help='earlier one (%(default)s)'
    )
    arguments = parser.parse_args()
    against = {'revision': arguments.against, 'rows': compared(arguments.against)}
    print(against_table(against), flush=True)
    rows = []
    print('µs a frame: one by one | at once (times real time)')
    for grid in GRIDS:
        for talking, name in ((0, 'quiet'), (len(TALKING), 'three markers')):
            frames = recording(grid, talking, FRAMES)
            for method in METHODS:
                single = microseconds(method, frames, at_once=False)
                many = microseconds(method, frames, at_once=True)
                speed = PERIOD_S / many * 1e6
                print(
                    f'{grid.zones:5d} zones  {name:13s}  {method:5s}  {single:7.0f} | {many:7.0f} '
                    f'({speed:.0f})',
                    flush=True,
                )
                rows.append(
                    {
                        'zones': grid.zones,
                        'talking': talking,
                        'method': method,
                        'frame_us': single,
                        'frame_at_once_us': many,
                        'times_real_time': speed,
                    }
                )
    growth = growth_megabytes(METHODS[0])
    print(f'{METHODS[0]} grows by {growth:.1f} MB in a quarter of an hour')
    if arguments.json is not None:
        figures = {'rows': rows, 'growth_mb': growth, 'against': against}
        write_figures(arguments.json, figures)


if __name__ == '__main__':
    main()
