# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Driver and detector with an emulated sensor: losses, stamps, latency and CPU share.

Then both in one process, also while somebody listens to the tracks of three markers; and
`landmarks`, with the readings of many sensors that stand still: delay and CPU share.

embedded/run python benchmarks/bench_nodes.py [--seconds SECONDS] [--json FILE]
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import defaultdict, deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing
from itertools import cycle, islice, product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
from tf2_msgs.msg import TFMessage

from evaluation.report.claims import write_figures
from retrolidar_ros.cli.demo import NAMESPACE, executable, start_emulator
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.detector.detection import place, zone_bearing
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import to_header, to_ns, to_pose, to_time, to_transform
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.qos import LATCHED
from retrolidar_ros.scene.files import find_scene
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.settings.resources import shared_file

SETTLING_S = 5.0
HALF_EXPOSURE_S = 0.0105
EXPOSED = 'end of the (last) exposure'
HALL_SENSORS, HALL_RATE_HZ = 16, 48.0
HALL_MARKERS = ((-0.15, -0.1, 1.0), (0.1, -0.05, 1.2), (0.2, 0.15, 1.4))  # before each [m]
HALL_FILLING = 45 * HALL_SENSORS * len(HALL_MARKERS)  # a landmark is made of 40 readings at most
RANGE_STDDEV_M = 0.001


def cpu_seconds(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def megabytes(pid: int) -> float:
    """Return the memory of a process, with its part of what it shares with others [MB]."""
    lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith('Pss:')) / 1024


def core_shares(
    listener: Listener, pids: Mapping[str, Sequence[int]], seconds: float
) -> dict[str, float]:
    """Listen for a time; return which share of one core processes took meanwhile, by name."""
    used_s = {name: sum(map(cpu_seconds, own)) for name, own in pids.items()}
    began_s = time.monotonic()
    listener.spin_until(lambda: False, seconds)
    elapsed_s = time.monotonic() - began_s
    return {
        name: (sum(map(cpu_seconds, own)) - used_s[name]) / elapsed_s for name, own in pids.items()
    }


class Run(NamedTuple):
    """What came of a sensor, and what that took."""

    seconds: float
    frames: list[tuple[FrameMsg, int]]
    markers: list[tuple[MarkerDetection, int]]
    tracks: list[tuple[MarkerTrack, int]]
    shares: dict[str, float]
    """Of one core, by process."""


def measure(duration_s: float, *, single_process: bool, with_tracks: bool = False) -> Run:
    """Run driver and detector, in two processes or in one, with an emulated sensor."""
    tracks: list[tuple[MarkerTrack, int]] = []
    names = ('reader',) if single_process else ('driver', 'detector')
    with (
        TemporaryDirectory() as directory,
        ProcessGroup(Path(directory)) as processes,
        closing(Listener(NAMESPACE)) as listener,
    ):
        port = Path(directory) / 'port'
        common = ['--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))]
        common += ['-r', f'__ns:={NAMESPACE}', '-p', f'serial_port:={port}']
        for name in names:
            processes.start(name, [executable(name), *common])
        node = listener.node
        if with_tracks:
            node.create_subscription(
                MarkerTrack,
                f'{NAMESPACE}/tracks',
                lambda message: tracks.append((message, time.time_ns())),
                1000,
            )
        if not listener.spin_until(
            lambda: all(node.count_publishers(topic) for topic in ('frames', 'markers')), 30.0
        ):
            sys.exit(f'{" and ".join(names)} did not start')
        start_emulator(processes, str(find_scene('coffee')), port)
        if not listener.spin_until(lambda: bool(listener.frames), 30.0):
            sys.exit('no frames came')
        listener.spin_until(lambda: False, SETTLING_S)
        settled = len(listener.frames)
        tracks.clear()
        pids = {name: [processes.pid(name)] for name in (*names, 'emulator')}
        shares = core_shares(listener, pids, duration_s)
    frames = listener.frames[settled:]
    first_ns = to_ns(frames[0][0].header.stamp)
    markers = [pair for pair in listener.markers if to_ns(pair[0].start) > first_ns]
    return Run(duration_s, frames, markers, tracks, shares)


def hall_readings(rng: np.random.Generator) -> Iterator[MarkerDetection]:
    """Return one reading after the other of all markers of a hall, without stamps."""
    grid = ZoneGrid()
    for sensor, marker in product(range(HALL_SENSORS), HALL_MARKERS):
        at_m = np.array(marker)
        column, row = np.rint(at_m[:2] / at_m[2] / grid.pitch + 1.5).astype(int)
        range_m = float(np.linalg.norm(at_m) + rng.normal(0, RANGE_STDDEV_M))
        spot = place(zone_bearing(int(4 * row + column), grid), range_m, RANGE_STDDEV_M)
        message = MarkerDetection(id=1 + HALL_MARKERS.index(marker))
        message.header.frame_id = f'sensor{sensor}'
        message.child_frame_id = f'sensor{sensor}_marker_{message.id}'
        message.range, message.range_stddev = range_m, RANGE_STDDEV_M
        message.pose.pose = to_pose(spot.position_m, spot.orientation)
        message.pose.covariance = spot.covariance.ravel()
        yield message


def measure_landmarks(duration_s: float) -> dict[str, float]:
    """Run the node `landmarks` with a hall of sensors; print and return delays and its load."""
    rng = np.random.default_rng(1)
    with (
        TemporaryDirectory() as directory,
        ProcessGroup(Path(directory)) as processes,
        closing(Listener('/hall')) as listener,
    ):
        node = listener.node
        options = ['--ros-args', '-r', f'__ns:={NAMESPACE}']
        processes.start('landmarks', [executable('landmarks'), *options])
        markers = node.create_publisher(MarkerDetection, f'{NAMESPACE}/markers', 1000)
        static = node.create_publisher(TFMessage, '/tf_static', LATCHED)
        upright = np.array([0.0, 0.0, 0.0, 1.0])
        ways = [
            to_transform(
                to_header(0, 'base_link'),
                f'sensor{index}',
                to_pose(np.array([0.5 * index, 0.0, 0.0]), upright),
            )
            for index in range(HALL_SENSORS)
        ]
        static.publish(TFMessage(transforms=ways))
        if not listener.spin_until(lambda: markers.get_subscription_count() > 0, 30.0):
            sys.exit('landmarks did not start')
        sent: defaultdict[str, deque[tuple[int, float]]] = defaultdict(deque)
        delays_s: list[float] = []

        def take_transforms() -> bool:
            """Take note of transforms, each of which answers all readings up to its stamp."""
            for transform in listener.transforms:
                newest_ns = to_ns(transform.header.stamp) + 1000  # but for its rounding
                waiting = sent[transform.child_frame_id.removeprefix('landmark_')]
                while waiting and waiting[0][0] <= newest_ns:
                    delays_s.append(time.monotonic() - waiting.popleft()[1])
            listener.transforms.clear()
            return False

        def feed(rate_hz: float, number: int) -> int:
            """Publish so many readings; return how many are not answered."""
            due_s = time.monotonic()
            for message in islice(cycle(hall_readings(rng)), number):
                message.header.stamp = to_time(time.time_ns())
                sent[message.child_frame_id].append((to_ns(message.header.stamp), time.monotonic()))
                markers.publish(message)
                due_s += 1 / rate_hz
                listener.spin_until(take_transforms, max(0.0, due_s - time.monotonic()))
            listener.spin_until(take_transforms, SETTLING_S)
            return sum(map(len, sent.values()))

        before = feed(2 * HALL_RATE_HZ, HALL_FILLING)
        delays_s.clear()
        begin_s, began_s = cpu_seconds(processes.pid('landmarks')), time.monotonic()
        number = round(duration_s * HALL_RATE_HZ)
        lost = feed(HALL_RATE_HZ, number) - before
        elapsed_s = time.monotonic() - began_s - SETTLING_S
        share = (cpu_seconds(processes.pid('landmarks')) - begin_s) / elapsed_s
    median, worst = 1e3 * np.percentile(delays_s, [50, 100])
    print(
        f'{number / elapsed_s:.0f} readings a second of {len(sent)} landmarks: {share:.1%} of a '
        f'core, {median:.0f} ms to the pose, at most {worst:.0f} ms; {lost} without a pose'
    )
    return {'core_share': share, 'median_ms': median, 'worst_ms': worst, 'without_pose': lost}


def report(run: Run) -> dict[str, object]:
    """Print a run; return its figures."""
    sequence = np.array([message.sequence for message, _ in run.frames])
    stamp_s = np.array([to_ns(message.header.stamp) for message, _ in run.frames]) * 1e-9
    sensor_s = np.array([message.sensor_time for message, _ in run.frames]) * 1e-6
    line = np.polyfit(sensor_s - sensor_s[0], stamp_s - stamp_s[0], 1)
    error_ms = 1e3 * (stamp_s - stamp_s[0] - np.polyval(line, sensor_s - sensor_s[0]))
    lost = int(sequence[-1] - sequence[0] + 1 - len(sequence))
    rate = (len(sequence) - 1) / (stamp_s[-1] - stamp_s[0])
    print(f'{run.seconds:.0f} s, {len(sequence)} frames at {rate:.1f} Hz, {lost} lost')
    print(
        f'stamps against the exposure: standard deviation {error_ms.std():.3f} ms, '
        f'largest {np.abs(error_ms).max():.3f} ms'
    )
    exposed_ns = 1e9 * HALF_EXPOSURE_S
    frame_ns = {to_ns(message.header.stamp): received for message, received in run.frames}
    ends = [(to_ns(message.end), received) for message, received in run.markers]
    tracks = [(to_ns(message.header.stamp), received) for message, received in run.tracks]
    delays = {}
    for begin, what, delays_ns in (
        (EXPOSED, 'Frame', [at - stamp - exposed_ns for stamp, at in frame_ns.items()]),
        (EXPOSED, 'MarkerDetection', [at - end - exposed_ns for end, at in ends]),
        # What is on the way at the ends of the run is left out.
        (
            'last Frame received',
            'its MarkerDetection',
            [at - frame_ns[end] for end, at in ends if end in frame_ns],
        ),
        ('end of the exposure', 'MarkerTrack', [at - stamp - exposed_ns for stamp, at in tracks]),
    ):
        if not delays_ns:
            continue
        median, p99 = 1e-6 * np.percentile(delays_ns, [50, 99])
        delays[what] = {
            'median_ms': float(median),
            'p99_ms': float(p99),
            'messages': len(delays_ns),
        }
        print(
            f'{begin} to {what} received: median {median:.1f} ms, '
            f'p99 {p99:.1f} ms, {len(delays_ns)} messages'
        )
    for name, share in run.shares.items():
        print(f'CPU share of {name}: {share:.1%} of one core')
    return {
        'seconds': run.seconds,
        'frames': len(sequence),
        'rate_hz': float(rate),
        'lost': lost,
        'stamp_stddev_ms': float(error_ms.std()),
        'stamp_worst_ms': float(np.abs(error_ms).max()),
        'delays': delays,
        'core_shares': run.shares,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seconds', type=float, default=60.0, help='(default: %(default)s)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    arguments = parser.parse_args()
    print('driver and detector, a process each')
    figures = report(measure(arguments.seconds, single_process=False))
    print('\nboth in one process, the reader')
    figures['single_process'] = report(measure(arguments.seconds, single_process=True))
    print('\nthe reader, with tracks')
    tracks = measure(arguments.seconds, single_process=True, with_tracks=True)
    figures['with_tracks'] = report(tracks)
    print('\nlandmarks, in a hall')
    figures['landmarks'] = measure_landmarks(arguments.seconds)
    if arguments.json is not None:
        write_figures(arguments.json, figures)


if __name__ == '__main__':
    main()
