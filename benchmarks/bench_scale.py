# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many sensors a machine and a network can take.

embedded/run python benchmarks/bench_scale.py [--seconds S] [--most N]

It prints the load of more and more pairs of driver and detector until the machine keeps up no
longer, beside that of one reader of as many sensors; and the traffic of one through the loopback
interface. Each sensor sees three markers that never stop talking. Whatever else runs on the
machine, or talks through its loopback interface, is measured as well.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from bench_nodes import HALF_EXPOSURE_S, SETTLING_S, cpu_seconds, megabytes
from bench_reader import REPORT_TIMEOUT_S, measure_reader
from builtin_interfaces.msg import Time
from dds_traffic import measure_traffic, print_traffic
from many_sensors import PERIOD_S, CountListener, Counts, NodePairs
from numpy.typing import NDArray

from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.nodes.conversion import to_ns

PAIRS = (1, *range(2, 20, 2), *range(20, 65, 4))
MOST_LOST = 0.01
MOST_LATE_PERIODS = 2.0
MOST_BUSY = 0.95


class Load(NamedTuple):
    """What pairs of nodes do to a machine; shares are of one core."""

    pairs: int
    drivers: float
    detectors: float
    sensors: float
    busy: float
    """All that runs on the machine, as a share of all cores."""
    lost: float
    """Share of the frames sent that no detector took; half a frame a sensor may be wrong."""
    frame_ms: float
    """From the end of an exposure to its frame's receipt, 95th percentile of one sensor."""
    marker_ms: float
    """From the end of the last exposure used to a detection's receipt, median of one sensor."""
    pair_mb: float

    @property
    def pair(self) -> float:
        """What one pair takes of a core."""
        return (self.drivers + self.detectors) / self.pairs

    def keeps_up(self) -> bool:
        """Tell whether the machine can take so many."""
        in_time = self.frame_ms <= MOST_LATE_PERIODS * PERIOD_S * 1e3
        return in_time and self.lost <= MOST_LOST and self.busy <= MOST_BUSY


def frame_rate(before: Counts, after: Counts) -> float:
    """Return how many frames were counted in all namespaces [Hz]."""
    rate = 0.0
    for namespace, (begin_s, first) in before.items():
        end_s, last = after[namespace]
        if end_s > begin_s:  # a node that cannot even report counts nothing
            rate += (last - first) / (end_s - begin_s)
    return rate


def delay_ms(received: list[tuple[Time, int]], percent: float) -> float:
    """Return a percentile of the time from the (last) exposure's end to receipt [ms].

    If there are no messages, as on a machine that is far too busy, it is NaN.
    """
    delays = [
        1e-6 * (received_ns - to_ns(stamp)) - 1e3 * HALF_EXPOSURE_S
        for stamp, received_ns in received
    ]
    return float(np.percentile(delays, percent)) if delays else math.nan


def busy_and_total() -> NDArray[np.int64]:
    """Return for how long all cores have been busy, and have been there [ticks]."""
    ticks = np.array(Path('/proc/stat').read_text().split(maxsplit=9)[1:9], dtype=np.int64)
    return np.array([ticks.sum() - ticks[3] - ticks[4], ticks.sum()])


def measure_load(pairs: int, seconds: float) -> Load:
    """Run pairs of nodes, each with a sensor."""
    with TemporaryDirectory() as directory, ProcessGroup(Path(directory)) as processes:
        nodes = NodePairs(processes, Path(directory), pairs)
        pids = {'sensors': [nodes.plug_in()]}
        pids |= {node: nodes.pids(node) for node in ('driver', 'detector')}
        with closing(CountListener(nodes.namespaces)) as listener:
            if not listener.spin_until(
                lambda: len(listener.sent) == len(listener.taken) == pairs, REPORT_TIMEOUT_S
            ):
                raise TimeoutError(f'some of {pairs} pairs do not report')
            listener.spin_until(lambda: False, SETTLING_S)
            sent, taken = listener.sent.copy(), listener.taken.copy()
            frames, markers = len(listener.frames), len(listener.markers)
            used_s = {node: sum(map(cpu_seconds, own)) for node, own in pids.items()}
            ticks, begin_s = busy_and_total(), time.monotonic()
            listener.spin_until(lambda: False, seconds)
            elapsed_s = time.monotonic() - begin_s
            busy, total = busy_and_total() - ticks
            shares = {
                node: (sum(map(cpu_seconds, own)) - used_s[node]) / elapsed_s
                for node, own in pids.items()
            }
            memory_mb = sum(map(megabytes, pids['driver'] + pids['detector']))
    rates = frame_rate(sent, listener.sent), frame_rate(taken, listener.taken)
    return Load(
        pairs=pairs,
        drivers=shares['driver'],
        detectors=shares['detector'],
        sensors=shares['sensors'],
        busy=busy / total,
        lost=max(0.0, 1 - rates[1] / rates[0]),
        frame_ms=delay_ms([(m.header.stamp, at) for m, at in listener.frames[frames:]], 95),
        marker_ms=delay_ms([(m.end, at) for m, at in listener.markers[markers:]], 50),
        pair_mb=memory_mb / pairs,
    )


def print_loads(most: int, seconds: float) -> None:
    """Print the load of more and more pairs, and of one reader of as many sensors."""
    print(
        f'Pairs of nodes, on {os.cpu_count()} cores; shares of one core\n'
        '                                                                                 | '
        'one reader\n'
        'pairs  drivers  detectors  sensors  a pair  all cores  frames  frames  markers  MB a | '
        '   all  a sensor  frames    MB\n'
        '                                                 busy    lost  p95 ms   med ms  pair | '
        '                    lost'
    )
    for pairs in [number for number in PAIRS if number <= most]:
        load = measure_load(pairs, seconds)
        reader = measure_reader(pairs, seconds)
        print(
            f'{pairs:5d}  {load.drivers:7.1%}  {load.detectors:9.1%}  {load.sensors:7.1%}  '
            f'{load.pair:6.1%}  {load.busy:9.1%}  {load.lost:6.2%}  {load.frame_ms:6.1f}  '
            f'{load.marker_ms:7.1f}  {load.pair_mb:4.0f} | {reader.share:6.1%}  '
            f'{reader.share / pairs:8.1%}  '
            f'{reader.lost:6d}  {reader.memory_mb:4.0f}',
            flush=True,
        )
        if not load.keeps_up():
            print(f'the machine does not keep up with {pairs}')
            return


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seconds', type=float, default=20.0, help='of every measurement')
    parser.add_argument('--most', type=int, default=PAIRS[-1], help='pairs of nodes')
    arguments = parser.parse_args()
    print_loads(arguments.most, arguments.seconds)
    with ProcessPoolExecutor(1, get_context('spawn')) as pool:
        print_traffic(pool.submit(measure_traffic, arguments.seconds).result())


if __name__ == '__main__':
    main()
