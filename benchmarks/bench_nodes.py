# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Driver and detector with an emulated sensor: losses, stamps, latency and CPU share.

embedded/run python benchmarks/bench_nodes.py [--seconds SECONDS] [--json FILE]
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from evaluation.report.claims import write_figures
from retrolidar_ros.cli.demo import NAMESPACE, executable, start_emulator
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import find_scene
from retrolidar_ros.settings.resources import shared_file

SETTLING_S = 5.0
HALF_EXPOSURE_S = 0.0105


def cpu_seconds(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def megabytes(pid: int) -> float:
    """Return the memory of a process, with its part of what it shares with others [MB]."""
    lines = Path(f'/proc/{pid}/smaps_rollup').read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith('Pss:')) / 1024


class Run(NamedTuple):
    """What came of a sensor, and what that took."""

    elapsed_s: float
    frames: list[tuple[FrameMsg, int]]
    markers: list[tuple[MarkerDetection, int]]
    shares: dict[str, float]
    """Of one core, by process."""


def measure(duration_s: float, *, single_process: bool) -> Run:
    """Run driver and detector, in two processes or in one, with an emulated sensor."""
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
        if not listener.spin_until(
            lambda: all(node.count_publishers(topic) for topic in ('frames', 'markers')), 30.0
        ):
            sys.exit(f'{" and ".join(names)} did not start')
        start_emulator(processes, str(find_scene('coffee')), port)
        if not listener.spin_until(lambda: bool(listener.frames), 30.0):
            sys.exit('no frames came')
        listener.spin_until(lambda: False, SETTLING_S)
        settled = len(listener.frames)
        pids = {name: processes.pid(name) for name in (*names, 'emulator')}
        before = {name: cpu_seconds(pid) for name, pid in pids.items()}
        began = time.monotonic()
        listener.spin_until(lambda: False, duration_s)
        elapsed_s = time.monotonic() - began
        shares = {name: (cpu_seconds(pid) - before[name]) / elapsed_s for name, pid in pids.items()}
    frames = listener.frames[settled:]
    first_ns = to_ns(frames[0][0].header.stamp)
    markers = [pair for pair in listener.markers if to_ns(pair[0].start) > first_ns]
    return Run(elapsed_s, frames, markers, shares)


def report(run: Run) -> dict[str, object]:
    """Print a run; return its figures."""
    frames, markers = run.frames, run.markers
    sequence = np.array([message.sequence for message, _ in frames])
    stamp_s = np.array([to_ns(message.header.stamp) for message, _ in frames]) * 1e-9
    sensor_s = np.array([message.sensor_time for message, _ in frames]) * 1e-6
    line = np.polyfit(sensor_s - sensor_s[0], stamp_s - stamp_s[0], 1)
    error_ms = 1e3 * (stamp_s - stamp_s[0] - np.polyval(line, sensor_s - sensor_s[0]))
    arrival_s = np.array([received for _, received in frames]) * 1e-9
    delay_ms = 1e3 * (arrival_s - stamp_s - HALF_EXPOSURE_S)
    latency_ms = 1e3 * np.array(
        [(received - to_ns(message.end)) * 1e-9 - HALF_EXPOSURE_S for message, received in markers]
    )
    lost = int(sequence[-1] - sequence[0] + 1 - len(sequence))
    rate = (len(sequence) - 1) / (stamp_s[-1] - stamp_s[0])
    print(f'{run.elapsed_s:.0f} s, {len(sequence)} frames at {rate:.1f} Hz, {lost} lost')
    print(
        f'stamps against the exposure: standard deviation {error_ms.std():.3f} ms, '
        f'largest {np.abs(error_ms).max():.3f} ms'
    )
    frame_ns = {to_ns(message.header.stamp): received for message, received in frames}
    # What is on the way at the ends of the run is left out.
    after_ms = 1e-6 * np.array(
        [
            received - frame_ns[to_ns(message.end)]
            for message, received in markers
            if to_ns(message.end) in frame_ns
        ]
    )
    delays = {}
    for begin, what, values in (
        ('end of the (last) exposure', 'Frame', delay_ms),
        ('end of the (last) exposure', 'MarkerDetection', latency_ms),
        ('last Frame received', 'its MarkerDetection', after_ms),
    ):
        median, p99 = np.percentile(values, [50, 99])
        delays[what] = {'median_ms': float(median), 'p99_ms': float(p99), 'messages': len(values)}
        print(
            f'{begin} to {what} received: median {median:.1f} ms, '
            f'p99 {p99:.1f} ms, {len(values)} messages'
        )
    for name, share in run.shares.items():
        print(f'CPU share of {name}: {share:.1%} of one core')
    return {
        'seconds': run.elapsed_s,
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
    if arguments.json is not None:
        write_figures(arguments.json, figures)


if __name__ == '__main__':
    main()
