# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Many sensors in one process, the reader: share of a core, and frames lost.

embedded/run python benchmarks/bench_reader.py [--sensors N] [--seconds S]

Each sensor sees three markers that never stop talking; nobody listens to frames.
"""

from __future__ import annotations

import argparse
import sys
import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from bench_nodes import SETTLING_S, cpu_seconds, megabytes
from many_sensors import CountListener

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup

REPORT_TIMEOUT_S = 30.0


class ReaderLoad(NamedTuple):
    """What a reader of many sensors does."""

    share: float
    """Of one core."""
    judged: int
    """Frames."""
    lost: int
    """Frames, on the way to the drivers or from there to the detectors."""
    memory_mb: float


def measure_reader(sensors: int, seconds: float) -> ReaderLoad:
    """Run a reader of as many sensors."""
    names = [f'sensor{index}' for index in range(sensors)]
    with TemporaryDirectory() as directory, ProcessGroup(Path(directory)) as processes:
        ports = [f'{directory}/{name}' for name in names]
        command = [executable('reader'), '--ros-args', '-r', '__ns:=/hall', '-p', f'ports:={ports}']
        processes.start('reader', command)
        many = str(Path(__file__).with_name('many_sensors.py'))
        processes.start('sensors', [sys.executable, many, *ports])
        # Of another namespace, so that no frames cross.
        with closing(CountListener(['/elsewhere'])) as listener:
            if not listener.spin_until(
                lambda: (
                    len(listener.sent) == len(listener.taken) == sensors
                    and all(frames > 0 for _, frames in listener.taken.values())
                ),
                REPORT_TIMEOUT_S + sensors,
            ):
                raise TimeoutError(f'some of {sensors} sensors are not read')
            listener.spin_until(lambda: False, SETTLING_S)
            taken, lost = listener.taken.copy(), sum(listener.lost.values())
            used_s, began_s = cpu_seconds(processes.pid('reader')), time.monotonic()
            listener.spin_until(lambda: False, seconds)
            share = cpu_seconds(processes.pid('reader')) - used_s
            share /= time.monotonic() - began_s
            memory_mb = megabytes(processes.pid('reader'))
        judged = sum(listener.taken[name][1] - taken[name][1] for name in taken)
        lost = sum(listener.lost.values()) - lost
    return ReaderLoad(share, judged, lost, memory_mb)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--sensors', type=int, nargs='+', default=[1, 16])
    parser.add_argument('--seconds', type=float, default=20.0)
    arguments = parser.parse_args()
    for sensors in arguments.sensors:
        load = measure_reader(sensors, arguments.seconds)
        print(
            f'{sensors:3d} sensors: {load.share:.1%} of a core, {load.judged} frames judged, '
            f'{load.lost} lost, {load.memory_mb:.0f} MB'
        )


if __name__ == '__main__':
    main()
