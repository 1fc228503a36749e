# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many sensors a machine, a core and a network can take, and what a hall of them needs.

embedded/run python benchmarks/bench_scale.py [--seconds S] [--most N]

It prints the load of more and more pairs of driver and detector until the machine keeps up no
longer, beside that of one reader of as many sensors; what sensors cost in one process without DDS;
the traffic of one through the loopback interface; and what follows for halls. Each sensor sees
three markers that never stop talking, except where it says quiet. Whatever else runs on the
machine, or talks through its loopback interface, is measured as well.
"""

from __future__ import annotations

import os

# As in the nodes' executables: threads only get in each other's way in products of this size.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

import argparse
import math
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import closing
from dataclasses import replace
from itertools import islice
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple, TypeVar

import numpy as np
from bench_nodes import HALF_EXPOSURE_S, SETTLING_S, cpu_seconds, megabytes
from bench_reader import REPORT_TIMEOUT_S, measure_reader
from builtin_interfaces.msg import Time
from dds_traffic import Traffic, measure_traffic, print_traffic
from many_sensors import PERIOD_S, SCENE, CountListener, Counts, NodePairs, Replay
from numpy.typing import NDArray

from evaluation.report.claims import write_figures
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.detector import create_detector
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.sensor.wire import FrameReader

PAIRS = (1, *range(2, 20, 2), *range(20, 65, 4))
MOST_LOST = 0.01
MOST_LATE_PERIODS = 2.0
MOST_BUSY = 0.95
STREAMS = 16
FILLING_S = 12.0  # a detector holds the samples of as many packets as it may combine
HALLS = (100, 10_000)
HOST_CORES = 8
PLANNED_SHARE = 0.7  # of a core; the rest is for frames that come at once
Result = TypeVar('Result')


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


class Cost(NamedTuple):
    """What one sensor takes of a core and of memory, among others in one process."""

    share: float
    sensor_mb: float


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


def measure_loads(most: int, seconds: float) -> tuple[Load, Cost]:
    """Print the load of more and more pairs, and of one reader of as many sensors.

    Returns
    -------
    load : Load
        The last that the machine kept up with.
    reader : Cost
        Of a sensor in a reader of as many.
    """
    print(
        f'Pairs of nodes, on {os.cpu_count()} cores; shares of one core\n'
        '                                                                                 | '
        'one reader\n'
        'pairs  drivers  detectors  sensors  a pair  all cores  frames  frames  markers  MB a | '
        '   all  a sensor  frames    MB\n'
        '                                                 busy    lost  p95 ms   med ms  pair | '
        '                    lost'
    )
    kept = None
    for pairs in [number for number in PAIRS if number <= most]:
        try:
            load = measure_load(pairs, seconds)
        except TimeoutError as error:
            if kept is None:
                raise
            print(error)
            return kept
        reader = measure_reader(pairs, seconds)
        cost = Cost(reader.share / pairs, reader.memory_mb / pairs)
        print(
            f'{pairs:5d}  {load.drivers:7.1%}  {load.detectors:9.1%}  {load.sensors:7.1%}  '
            f'{load.pair:6.1%}  {load.busy:9.1%}  {load.lost:6.2%}  {load.frame_ms:6.1f}  '
            f'{load.marker_ms:7.1f}  {load.pair_mb:4.0f} | {reader.share:6.1%}  {cost.share:8.1%}  '
            f'{reader.lost:6d}  {reader.memory_mb:4.0f}',
            flush=True,
        )
        if not load.keeps_up():
            print(f'the machine does not keep up with {pairs}')
            return kept or (load, cost)
        kept = load, cost
    return load, cost


def measure_streams(method: str, markers: int, seconds: float) -> Cost:
    """Feed the bytes of many sensors to one process, a frame of each in turn; print the cost."""
    scene = replace(SCENE, markers=SCENE.markers[:markers])
    filling, rounds = round(FILLING_S / PERIOD_S), round((FILLING_S + seconds) / PERIOD_S)
    sensors = Replay(scene).sensors(STREAMS)
    streams = [[packet for _, packet in islice(sensor, rounds)] for sensor in sensors]
    empty_mb = megabytes(os.getpid())
    readers = [FrameReader() for _ in streams]
    detectors = [create_detector(method, scene.sensor.grid) for _ in streams]
    round_s = np.zeros(rounds)
    for turn in range(rounds):
        begin_s = time.process_time()
        for stream, reader, detector in zip(streams, readers, detectors, strict=True):
            for frame in reader.feed(stream[turn]):
                detector.update(frame)
        round_s[turn] = time.process_time() - begin_s
    sensor_mb = (megabytes(os.getpid()) - empty_mb) / STREAMS
    settled_s = round_s[filling:]
    share = float(settled_s.mean()) / PERIOD_S / STREAMS
    print(
        f'{method:6s}  {markers:7d}  {share:8.2%}  {1 / share:14.0f}  '
        f'{1e3 * settled_s.max():16.1f}  {sensor_mb:11.1f}',
        flush=True,
    )
    return Cost(share, sensor_mb)


def in_new_process(measure: Callable[..., Result], *arguments: object) -> Result:
    """Return what a function measures in a process that has done nothing else before."""
    with ProcessPoolExecutor(1, get_context('spawn')) as pool:
        return pool.submit(measure, *arguments).result()


def print_sizing(load: Load, costs: dict[str, Cost], traffic: Traffic) -> None:
    """Print what halls of many sensors need: extrapolated, as if nothing else grew."""
    ways = {'a pair of nodes each': Cost(load.pair, load.pair_mb), **costs}
    for hall in HALLS:
        print(
            f'\nextrapolated: {hall} sensors, hosts of {HOST_CORES} cores, '
            f'{PLANNED_SHARE:.0%} of a core used\n'
            '                                       a core  MB each  cores  hosts  memory GB'
        )
        for way, cost in ways.items():
            cores = math.ceil(hall * cost.share / PLANNED_SHARE)
            print(
                f'{way:37s}  {PLANNED_SHARE / cost.share:6.1f}  {cost.sensor_mb:7.1f}  {cores:5d}  '
                f'{math.ceil(cores / HOST_CORES):5d}  {hall * cost.sensor_mb / 1024:9.1f}'
            )
        hosted = min(hall, HOST_CORES * PLANNED_SHARE / load.pair)
        print(
            f'trunk: {hall * traffic.frames / 1e3:.1f} Mbit/s if frames cross it, '
            f'{hall * traffic.detections / 1e3:.1f} Mbit/s if only detections do\n'
            f'discovery among pairs of nodes: {traffic.discovery(2 * hall) / 1e3:.0f} Mbit/s in '
            'one domain, '
            f'{traffic.discovery(2 * hosted) / 1e3:.1f} Mbit/s in a domain for each host'
        )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seconds', type=float, default=20.0, help='of every measurement')
    parser.add_argument('--most', type=int, default=PAIRS[-1], help='pairs of nodes')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    arguments = parser.parse_args()
    if arguments.most < 1:
        parser.error('--most must be at least 1')
    load, reader = measure_loads(arguments.most, arguments.seconds)
    if arguments.json is not None:
        write_figures(arguments.json, load._asdict())
    print(
        f'\n{STREAMS} sensors in one process without DDS\n'
        'method  markers  a sensor  sensors a core  longest round ms  MB a sensor'
    )
    costs = {'a reader of many': reader} | {
        f'one process a core, {method}, {markers} markers': in_new_process(
            measure_streams, method, markers, arguments.seconds
        )
        for method in ('joint', 'paper')
        for markers in (len(SCENE.markers), 0)
    }
    traffic = in_new_process(measure_traffic, arguments.seconds)
    print_traffic(traffic)
    print_sizing(load, costs, traffic)


if __name__ == '__main__':
    main()
