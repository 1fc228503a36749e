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
from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from many_sensors import Sensors

from evaluation.report.claims import write_figures
from retrolidar_ros.cli.demo import start_emulator
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.description import find_scene

SETTLING_S = 5.0
HALF_EXPOSURE_S = 0.0105
NODES = ('driver', 'detector')  # of a sensor, as they are started


def cpu_seconds(pid: int) -> float:
    """Return the processor time that a process has used [s]."""
    fields = Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


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


def measure(seconds: float) -> dict[str, object]:
    """Run driver and detector with an emulated sensor; return losses, stamps, delays and CPU."""
    with TemporaryDirectory() as directory, ProcessGroup(Path(directory)) as processes:
        sensors = Sensors(processes, Path(directory), 1)
        sensors.start_pairs()
        pids = {name: [pid] for name, pid in zip(NODES, sensors.pids(), strict=True)}
        with closing(Listener(sensors.namespaces[0])) as listener:
            start_emulator(processes, str(find_scene('coffee')), Path(sensors.ports[0]))
            if not listener.spin_until(lambda: bool(listener.frames), 30.0):
                sys.exit('no frames came')
            listener.spin_until(lambda: False, SETTLING_S)
            settled = len(listener.frames)
            shares = core_shares(listener, pids, seconds)
    frames = [message for message, _ in listener.frames[settled:]]
    sequence = np.array([message.sequence for message in frames])
    stamp_s = np.array([to_ns(message.header.stamp) for message in frames]) * 1e-9
    sensor_s = np.array([message.sensor_time for message in frames]) * 1e-6
    line = np.polyfit(sensor_s - sensor_s[0], stamp_s - stamp_s[0], 1)
    error_ms = 1e3 * (stamp_s - stamp_s[0] - np.polyval(line, sensor_s - sensor_s[0]))
    first_ns = to_ns(frames[0].header.stamp)
    delays_ms = [
        1e-6 * (received_ns - to_ns(message.end)) - 1e3 * HALF_EXPOSURE_S
        for message, received_ns in listener.markers
        if to_ns(message.start) > first_ns
    ]
    median_ms, p99_ms = np.percentile(delays_ms, [50, 99]).tolist()
    return {
        'seconds': seconds,
        'frames': len(sequence),
        'rate_hz': float((len(sequence) - 1) / (stamp_s[-1] - stamp_s[0])),
        'lost': int(sequence[-1] - sequence[0] + 1 - len(sequence)),
        'stamp_stddev_ms': float(error_ms.std()),
        'stamp_worst_ms': float(np.abs(error_ms).max()),
        # From the end of the last exposure until it is received.
        'delays': {'MarkerDetection': {'median_ms': median_ms, 'p99_ms': p99_ms}},
        'core_shares': shares,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seconds', type=float, default=60.0, help='(default: %(default)s)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures, too')
    arguments = parser.parse_args()
    figures = measure(arguments.seconds)
    for name, value in figures.items():
        print(f'{name}: {value}')
    if arguments.json is not None:
        write_figures(arguments.json, figures)


if __name__ == '__main__':
    main()
