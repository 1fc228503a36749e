# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Network traffic: of a sensor's nodes, and of discovery with and without a discovery server.

embedded/run python benchmarks/bench_network.py [--seconds S]

All talk by UDP through the loopback interface of this machine, as if each were on a host of its
own. To discovery, a reader is a node that publishes detections. Whatever else talks through the
interface is measured as well: `unshare -n` gives it one of its own.
"""

from __future__ import annotations

import argparse
import math
import os
import subprocess
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack, closing
from multiprocessing import get_context
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import rclpy
from bench_nodes import SETTLING_S
from diagnostic_msgs.msg import DiagnosticArray
from many_sensors import Sensors
from rclpy.node import Node

from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.listener import Listener

NUMBERS = (5, 20, 40)
PORT = 11811
ANNOUNCEMENT_S = 3.0  # every participant announces itself so often
# Participants talk by UDP as if they were on many hosts, yet nothing leaves this one.
LOOPBACK_PROFILE = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com">
  <profiles>
    <transport_descriptors>
      <transport_descriptor>
        <transport_id>loopback</transport_id>
        <type>UDPv4</type>
        <interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>
      </transport_descriptor>
    </transport_descriptors>
    <participant profile_name="loopback" is_default_profile="true">
      <rtps>
        <userTransports><transport_id>loopback</transport_id></userTransports>
        <useBuiltinTransports>false</useBuiltinTransports>
      </rtps>
    </participant>
  </profiles>
</dds>
"""


def _set(environment: dict[str, str]) -> None:
    os.environ.update(environment)


def call_apart(environment: dict[str, str], function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a function in a process of its own, as Fast DDS reads its environment only once."""
    spawn = get_context('spawn')
    with ProcessPoolExecutor(1, spawn, _set, (environment,)) as pool:
        return pool.submit(function, *arguments).result()


def loopback_bytes() -> int:
    """Return what the loopback interface has received, which is all that was sent to it."""
    lines = Path('/proc/net/dev').read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.split()[0] == 'lo:')


def loopback_kbit_s(seconds: float) -> float:
    """Return the traffic through the loopback interface, once the nodes have settled."""
    time.sleep(SETTLING_S)
    before = loopback_bytes()
    whole_s = math.ceil(seconds / ANNOUNCEMENT_S) * ANNOUNCEMENT_S
    time.sleep(whole_s)
    return 8e-3 * (loopback_bytes() - before) / whole_s


def _ignore(message: object) -> None:
    """Take a message; it has crossed the network by then."""


def measure_sensor(seconds: float) -> tuple[float, float]:
    """Return the traffic of a sensor [kbit/s]: frames, and all else."""
    with TemporaryDirectory() as name, ProcessGroup(Path(name)) as processes:
        sensors = Sensors(processes, Path(name), 1)
        sensors.start_pairs()
        two_idle = loopback_kbit_s(seconds)
        # In a namespace without nodes it receives no frames, but TF.
        with closing(Listener('/elsewhere')) as listener:
            three_idle = loopback_kbit_s(seconds)
            markers = f'{sensors.namespaces[0]}/markers'
            listener.node.create_subscription(MarkerDetection, markers, _ignore, 100)
            listener.node.create_subscription(DiagnosticArray, '/diagnostics', _ignore, 100)
            sensors.plug_in()
            everything = loopback_kbit_s(seconds) - three_idle
        frames = loopback_kbit_s(seconds) - two_idle
    return frames, everything - frames


def measure_discovery(number: int, seconds: float) -> tuple[float, float]:
    """Return what it takes that participants find each other [kB], and to stay so [kbit/s]."""
    before, contexts = loopback_bytes(), []
    for index in range(number):
        context = rclpy.Context()
        rclpy.init(context=context)
        node = Node('reader', namespace=f'/host{index}', context=context)
        node.create_publisher(MarkerDetection, 'markers', 10)
        contexts.append((context, node))
    time.sleep(SETTLING_S)
    found_kb = 1e-3 * (loopback_bytes() - before)
    steady_kbit_s = loopback_kbit_s(seconds)
    for context, node in contexts:
        node.destroy_node()
        rclpy.shutdown(context=context)
    return found_kb, steady_kbit_s


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition('\n')[0])
    parser.add_argument('--seconds', type=float, default=9.0, help='of every measurement')
    arguments = parser.parse_args()
    with TemporaryDirectory() as name, ExitStack() as stack:
        profile = Path(name) / 'profile.xml'
        profile.write_text(LOOPBACK_PROFILE)
        # Jazzy has shared memory of its own for the range LOCALHOST, whatever the profile says.
        alone = {
            'ROS_AUTOMATIC_DISCOVERY_RANGE': 'SYSTEM_DEFAULT',
            'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
        }
        frames, others = call_apart(alone, measure_sensor, arguments.seconds)
        print(
            'Traffic [kbit/s], IP headers included\n'
            f'frames of a sensor to its detector  {frames:7.1f}\n'
            f'its markers, TF and diagnostics     {others:7.1f}\n\n'
            'participants  without server: at start, steady   with server: at start, steady'
        )
        served = alone | {'ROS_DISCOVERY_SERVER': f'127.0.0.1:{PORT}'}
        command = ['fast-discovery-server', '-i', '0', '-l', '127.0.0.1', '-p', str(PORT)]
        server = stack.enter_context(subprocess.Popen(command, stdout=subprocess.DEVNULL))
        stack.callback(server.terminate)
        for number in NUMBERS:
            cells = ''
            for environment in (alone, served):
                settings = (number, arguments.seconds)
                found_kb, kbit_s = call_apart(environment, measure_discovery, *settings)
                cells += f'{found_kb:15.0f} kB {kbit_s:10.1f} kbit/s'
            print(f'{number:12d}  {cells}', flush=True)


if __name__ == '__main__':
    main()
