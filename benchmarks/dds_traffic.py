# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What drivers and detectors on different hosts send each other, measured on one host."""

from __future__ import annotations

import math
import os
import time
from contextlib import closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from bench_nodes import SETTLING_S
from diagnostic_msgs.msg import DiagnosticArray
from many_sensors import NodePairs

from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.listener import Listener

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


class Traffic(NamedTuple):
    """What nodes send through the network [kbit/s]."""

    frames: float
    """Of one sensor, to its detector."""
    second: float
    """The same to a second subscriber."""
    detections: float
    """Of one sensor: markers, TF, and the diagnostics of both nodes."""


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


def measure_traffic(seconds: float) -> Traffic:
    """Run nodes that send all they have to say through the loopback interface.

    It wants a process of its own, as Fast DDS reads its profile only once.
    """
    # Jazzy brings shared memory of its own to the range LOCALHOST, so the variable
    # FASTDDS_BUILTIN_TRANSPORTS has no effect there.
    os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'SYSTEM_DEFAULT'
    with TemporaryDirectory() as name:
        directory = Path(name)
        (directory / 'profile.xml').write_text(LOOPBACK_PROFILE)
        os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = str(directory / 'profile.xml')
        with ProcessGroup(directory) as processes:
            nodes = NodePairs(processes, directory, 1)
            two_idle = loopback_kbit_s(seconds)
            nodes.add_reader()
            three_idle = loopback_kbit_s(seconds)
            nodes.plug_in()
            to_two = loopback_kbit_s(seconds)
            nodes.remove_reader()
            frames = loopback_kbit_s(seconds) - two_idle
            # In a namespace without nodes it hears no frames, but TF.
            with closing(Listener('/elsewhere')) as listener:
                markers = f'{nodes.namespaces[0]}/markers'
                listener.node.create_subscription(MarkerDetection, markers, _ignore, 100)
                listener.node.create_subscription(DiagnosticArray, '/diagnostics', _ignore, 100)
                detections = loopback_kbit_s(seconds) - three_idle - frames
    return Traffic(frames, to_two - three_idle - frames, detections)


def print_traffic(traffic: Traffic) -> None:
    """Print traffic."""
    print(
        '\nTraffic [kbit/s], IP headers included\n'
        f'frames of a sensor to its detector  {traffic.frames:7.1f}\n'
        f'the same to a second subscriber     {traffic.second:7.1f}\n'
        f'its markers, TF and diagnostics     {traffic.detections:7.1f}'
    )
