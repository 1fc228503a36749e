# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What frames cost the default detector of whichever sources are on the path.

bench_detector.py runs it once for each revision, with the revision's sources in PYTHONPATH, and
so it knows where each has what it needs. It takes lines of a kind and a path, and answers each
with a line of JSON:

- `frames FILE`: processor time of each frame of a recording (.npz) [ns], taken one by one;
- `bag PATH`: processor time of all of it, from the disk to lines of JSON [ns].
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from time import process_time_ns

import numpy as np

from retrolidar_ros.bag import read_frames
from retrolidar_ros.detector import create_detector

try:
    from retrolidar_ros.detector.decoding import Decoding
    from retrolidar_ros.detector.parameters import defaults
    from retrolidar_ros.detector.text import to_json
    from retrolidar_ros.sensor.frame import Recording, ZoneGrid
except ModuleNotFoundError:  # before the package had rooms
    from retrolidar_ros.decoding import detect, to_json
    from retrolidar_ros.frame import Recording, ZoneGrid

    def readings(path: Path):
        """Return the detections in a bag."""
        return detect(read_frames(path), METHOD)
else:

    def readings(path: Path):
        """Return the detections in a bag."""
        return Decoding({**defaults(), 'method': METHOD}).detect(read_frames(path))


METHOD = 'joint'
ARRAYS = ('stamp_ns', 'sequence', 'sensor_time_us', 'distance', 'signal', 'ambient', 'status')


def save(file: Path, recording: Recording) -> None:
    """Write a recording for whichever revision."""
    grid = np.array([recording.grid.rows, recording.grid.columns])
    np.savez(file, grid=grid, **{name: getattr(recording, name) for name in ARRAYS})


def load(file: Path) -> Recording:
    """Return a recording that was saved."""
    with np.load(file) as saved:
        grid = ZoneGrid(*saved['grid'].tolist())
        return Recording(grid=grid, **{name: saved[name] for name in ARRAYS})


def time_frames(file: Path) -> list[int]:
    """Return the processor time of each frame of a recording [ns]."""
    recording = load(file)
    detector = create_detector(METHOD, recording.grid)
    frames = list(recording)
    stamps = [process_time_ns()]
    for frame in frames:
        detector.update(frame)
        stamps.append(process_time_ns())
    return [int(taken) for taken in np.diff(stamps)]


def time_bag(path: Path) -> float:
    """Return the processor time from a bag on disk to lines of JSON [s]."""
    begin = process_time_ns()
    for detection in readings(path):
        to_json(detection)
    return 1e-9 * (process_time_ns() - begin)


def times(file: Path, bag: Path) -> dict[str, object]:
    """Return the times of a recording and of a bag."""
    return {'frames_ns': time_frames(file), 'bag_s': time_bag(bag)}


if __name__ == '__main__':
    PATHS = [Path(path) for path in sys.argv[1:]]
    times(*PATHS[:2])  # what is loaded at first use does not count
    PAIRS = zip(PATHS[::2], PATHS[1::2], strict=True)
    print(json.dumps([times(*pair) for pair in PAIRS]))
