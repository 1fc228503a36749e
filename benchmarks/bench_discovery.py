# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Traffic of discovery among readers on hosts of their own, with and without a discovery server.

embedded/run python benchmarks/bench_discovery.py [--seconds S] [--most N]

Each participant is what a reader is to the others: a node that publishes detections. All talk by
UDP through the loopback interface of this machine, as if each were on a host of its own.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path
from tempfile import TemporaryDirectory

import rclpy
from dds_traffic import ANNOUNCEMENT_S, LOOPBACK_PROFILE, loopback_bytes
from rclpy.node import Node

from retrolidar_ros.msg import MarkerDetection

NUMBERS = (5, 10, 20, 40)
PORT = 11811
SETTLING_S = 6.0


def measure(number: int, seconds: float) -> tuple[float, float]:
    """Return what it takes that all find each other [kB], and to stay so [kbit/s]."""
    before, contexts = loopback_bytes(), []
    for index in range(number):
        context = rclpy.Context()
        rclpy.init(context=context)
        node = Node('reader', namespace=f'/host{index}', context=context)
        node.create_publisher(MarkerDetection, 'markers', 10)
        contexts.append((context, node))
    time.sleep(SETTLING_S)
    settled, whole_s = loopback_bytes(), round(seconds / ANNOUNCEMENT_S + 0.5) * ANNOUNCEMENT_S
    time.sleep(whole_s)
    idle = 8e-3 * (loopback_bytes() - settled) / whole_s
    for context, node in contexts:
        node.destroy_node()
        rclpy.shutdown(context=context)
    return 1e-3 * (settled - before), idle


def measured_apart(number: int, seconds: float, environment: dict[str, str]) -> list[float]:
    """Measure in a process of its own, as Fast DDS reads its surroundings only once."""
    command = [sys.executable, __file__, '--seconds', str(seconds), '--participants', str(number)]
    result = subprocess.run(
        command, env={**os.environ, **environment}, check=True, capture_output=True, text=True
    )
    return [float(word) for word in result.stdout.split()[-2:]]


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seconds', type=float, default=9.0, help='of every measurement')
    parser.add_argument('--most', type=int, default=NUMBERS[-1], help='participants')
    parser.add_argument('--participants', type=int, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.participants is not None:
        print(*measure(arguments.participants, arguments.seconds))
        return
    print('participants  all against all: to begin, to stay   by a server: to begin, to stay')
    with TemporaryDirectory() as name, ExitStack() as stack:
        profile = Path(name) / 'profile.xml'
        profile.write_text(LOOPBACK_PROFILE)
        alone = {
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT',
            'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
        }
        ways = (alone, {**alone, 'ROS_DISCOVERY_SERVER': f'127.0.0.1:{PORT}'})
        command = ['fast-discovery-server', '-i', '0', '-l', '127.0.0.1', '-p', str(PORT)]
        server = stack.enter_context(subprocess.Popen(command, stdout=subprocess.DEVNULL))
        stack.callback(server.terminate)
        for number in [number for number in NUMBERS if number <= arguments.most]:
            simple, served = (
                measured_apart(number, arguments.seconds, environment) for environment in ways
            )
            print(
                f'{number:12d}  {simple[0]:15.0f} kB {simple[1]:10.1f} kbit/s  '
                f'{served[0]:15.0f} kB {served[1]:6.1f} kbit/s',
                flush=True,
            )


if __name__ == '__main__':
    main()
