# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many sensors a machine can take: by a driver and a detector each, and by one reader.

embedded/run python benchmarks/bench_scale.py [--sensors N...] [--seconds S]

Each sensor sees three markers that never stop talking. Whatever else runs on the machine is
measured as well. Pairs of nodes are left out once the machine keeps up no longer.
"""

from __future__ import annotations

import argparse
import os
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from bench_nodes import SETTLING_S, core_shares
from many_sensors import TIMEOUT_S, FrameCounter, Sensors
from numpy.typing import NDArray

from retrolidar_ros.cli.processes import ProcessGroup

MAX_LOST = 0.01  # share of the frames
MAX_BUSY = 0.95  # share of all cores


class Load(NamedTuple):
    """The load of the nodes of some sensors."""

    share: float  # of one core
    busy: float  # all that runs on the machine, as a share of all cores
    taken: int  # frames, by the detectors
    lost: int  # frames, on the way to the drivers or from there to the detectors
    memory_mb: float

    def keeps_up(self) -> bool:
        """Tell whether the machine can take so many."""
        return self.busy <= MAX_BUSY and self.lost <= MAX_LOST * (self.taken + self.lost)


def megabytes(pid: int) -> float:
    """Return the memory of a process, with its part of what it shares with others [MB]."""
    lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith('Pss:')) / 1024


def busy_and_total() -> NDArray[np.int64]:
    """Return for how long all cores have been busy, and have been there [ticks]."""
    ticks = np.array(Path('/proc/stat').read_text().split(maxsplit=9)[1:9], dtype=np.int64)
    return np.array([ticks.sum() - ticks[3] - ticks[4], ticks.sum()])


def measure(number: int, seconds: float, *, one_reader: bool) -> Load:
    """Run the nodes of some sensors, in one process or in two of each sensor."""
    with TemporaryDirectory() as directory, ProcessGroup(Path(directory)) as processes:
        sensors = Sensors(processes, Path(directory), number)
        if one_reader:
            sensors.start_reader()
        else:
            sensors.start_pairs()
        sensors.plug_in()
        pids = sensors.pids()
        with closing(FrameCounter()) as counter:
            if not counter.spin_until(
                lambda: len(counter.taken) == number and all(counter.taken.values()), TIMEOUT_S
            ):
                raise TimeoutError(f'some of {number} sensors are not read')
            counter.spin_until(lambda: False, SETTLING_S)
            taken, lost = sum(counter.taken.values()), sum(counter.lost.values())
            ticks = busy_and_total()
            share = core_shares(counter, {'nodes': pids}, seconds)['nodes']
            busy, total = busy_and_total() - ticks
            memory_mb = sum(map(megabytes, pids))
        taken, lost = sum(counter.taken.values()) - taken, sum(counter.lost.values()) - lost
    return Load(share, busy / total, taken, lost, memory_mb)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--sensors', type=int, nargs='+', default=[1, 4, 16])
    parser.add_argument('--seconds', type=float, default=20.0, help='of every measurement')
    arguments = parser.parse_args()
    print(f'{os.cpu_count()} cores; shares of one core, and of all by whatever runs')
    keeps_up = True
    for number in arguments.sensors:
        for name, one_reader in (('driver and detector each', False), ('one reader', True)):
            if one_reader or keeps_up:
                load = measure(number, arguments.seconds, one_reader=one_reader)
                keeps_up &= one_reader or load.keeps_up()
                print(
                    f'{number:3d} sensors, {name:24}: {load.share:6.1%} of a core, '
                    f'{load.busy:5.1%} of all, {load.memory_mb:4.0f} MB, '
                    f'{load.lost} of {load.taken + load.lost} frames lost',
                    flush=True,
                )


if __name__ == '__main__':
    main()
