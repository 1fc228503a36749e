# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Many emulated sensors, and a driver and a detector for each.

embedded/run python benchmarks/many_sensors.py LINK...

As a program it is the sensors: at each link one of them replays the scene `coffee` in real time,
until the program is interrupted. One process serves them all, from frames computed beforehand, to
leave the processor to the nodes.
"""

from __future__ import annotations

import heapq
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from itertools import count
from pathlib import Path
from struct import Struct
from typing import TypeAlias

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.emulator import PortLink
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.wire import DELIMITER, cobs_decode, encode_frame, encode_packet
from retrolidar_ros.settings.resources import shared_file

SCENE = load_scene('coffee')
PERIOD_S = SCENE.sensor.period_s
REPLAY_S = 60.0  # packets are cut where the replay begins again, so that should be rare
TIMEOUT_S = 120.0
_ALL_READ = 'every port is read'
_COUNTERS = Struct('<IQ')  # sequence and sensor time, which follow the kind
_KIND_BYTES = 1
_CRC_BYTES = 2

Counts: TypeAlias = 'dict[str, tuple[float, int]]'
"""Frames of each namespace, and when they were counted [s]."""


class Replay:
    """A scene over and over, as sensors send it; sequence and sensor time go on."""

    def __init__(self, scene: Scene) -> None:
        """Compute the frames."""
        frames = list(Simulation(scene).run(REPLAY_S))
        self._packets = [cobs_decode(encode_frame(frame).rstrip(DELIMITER)) for frame in frames]
        self._times_us = [frame.sensor_time_us for frame in frames]
        self._turn_us = self._times_us[-1] - self._times_us[0] + round(PERIOD_S * 1e6)

    def sensors(self, number: int) -> list[Iterator[tuple[float, bytes]]]:
        """Return the endless packets of sensors that are spread evenly over the scene.

        With each packet comes the time since the sensor's first [s].
        """
        return [self._sensor(index * len(self._packets) // number) for index in range(number)]

    def _sensor(self, first: int) -> Iterator[tuple[float, bytes]]:
        start_us = self._times_us[first]
        for sequence in count():
            turn, index = divmod(first + sequence, len(self._packets))
            time_us = turn * self._turn_us + self._times_us[index]
            content = bytearray(self._packets[index][:-_CRC_BYTES])
            _COUNTERS.pack_into(content, _KIND_BYTES, sequence, time_us)
            yield (time_us - start_us) * 1e-6, encode_packet(bytes(content))


def serve(ports: Sequence[PortLink]) -> None:
    """Send the packets of all sensors when they are due, and say when all are being read."""
    sensors = Replay(SCENE).sensors(len(ports))
    now_s = time.monotonic()
    # Nobody synchronises sensors, so they are spread over the frame period, too.
    starts_s = [now_s + index * PERIOD_S / len(ports) for index in range(len(ports))]
    due = [(starts_s[index], index, next(sensor)[1]) for index, sensor in enumerate(sensors)]
    unread = set(range(len(ports)))
    while True:
        due_s, index, packet = due[0]
        time.sleep(max(0.0, due_s - time.monotonic()))
        if ports[index].write(packet) and index in unread:
            unread.remove(index)
            if not unread:
                print(_ALL_READ, flush=True)
        since_s, packet = next(sensors[index])
        heapq.heapreplace(due, (starts_s[index] + since_s, index, packet))


class NodePairs:
    """Drivers and detectors in processes of their own, each pair in its own namespace."""

    def __init__(self, processes: ProcessGroup, directory: Path, pairs: int) -> None:
        """Start the nodes as `demo.start_nodes` does, and wait until all are there."""
        self.namespaces = [f'/pair{index}' for index in range(pairs)]
        self._processes = processes
        self._ports = [directory / f'port{index}' for index in range(pairs)]
        for namespace, port in zip(self.namespaces, self._ports, strict=True):
            self._start('driver', namespace, '-p', f'serial_port:={port}')
            self._start('detector', namespace)
        topics = [
            f'{space}/{topic}' for space in self.namespaces for topic in ('frames', 'markers')
        ]
        self._wait(lambda node: all(node.count_publishers(topic) for topic in topics))

    def pids(self, node: str) -> list[int]:
        """Return the process IDs of all nodes that are a `driver` or a `detector`."""
        return [self._processes.pid(_process(node, namespace)) for namespace in self.namespaces]

    def add_reader(self) -> None:
        """Start one more detector, for the frames of the first pair, and wait for it."""
        self._start('detector', '/second', '-r', f'frames:={self.namespaces[0]}/frames')
        self._wait(lambda node: node.count_publishers('/second/markers') > 0)

    def plug_in(self) -> int:
        """Give every driver a sensor; return their process ID when all of them are being read."""
        ports = [str(port) for port in self._ports]
        self._processes.start('sensors', [sys.executable, __file__, *ports])
        log = self._processes.log('sensors')
        self._wait(lambda _: _ALL_READ in log.read_text())
        return self._processes.pid('sensors')

    def remove_reader(self) -> None:
        """Stop the detector that was added."""
        self._processes.stop(_process('detector', '/second'))

    def _start(self, node: str, namespace: str, *arguments: str) -> None:
        common = ['--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))]
        command = [executable(node), *common, '-r', f'__ns:={namespace}', *arguments]
        self._processes.start(_process(node, namespace), command)

    def _wait(self, done: Callable[[Node], bool]) -> None:
        """Watch the graph by a node that is there no longer than this takes."""

        def is_done() -> bool:
            self._processes.check()
            return done(listener.node)

        with closing(Listener('/start')) as listener:
            if not listener.spin_until(is_done, TIMEOUT_S):
                raise TimeoutError(
                    f'{len(self.namespaces)} pairs were not there in {TIMEOUT_S:g} s'
                )


class CountListener(Listener):
    """Hears the first pair, and of all pairs how many frames were sent and taken."""

    def __init__(self, namespaces: list[str]) -> None:
        """Join the graph."""
        super().__init__(namespaces[0])
        self.sent: Counts = {}
        self.taken: Counts = {}
        self.lost: dict[str, int] = {}
        """Frames that each node says are missing between those that it got."""
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._count, 1000)

    def _count(self, message: DiagnosticArray) -> None:
        stamp_s = to_ns(message.header.stamp) * 1e-9
        for status in message.status:
            namespace, _, node = status.name.partition(':')[0].rpartition('/')
            values = {pair.key: pair.value for pair in status.values}
            if 'frames' not in values:  # not configured
                continue
            self.lost[status.name] = int(values['lost frames'])
            if node == 'driver':
                sent = int(values['frames']) + int(values['lost frames'])
                self.sent[namespace] = (stamp_s, sent)
            else:
                self.taken[namespace] = (stamp_s, int(values['frames']))


def _process(node: str, namespace: str) -> str:
    """Return the name of a node's process, which is also that of its log file."""
    return f'{node}_{namespace[1:]}'


def main() -> None:
    """Serve the links that the command line names."""
    with suppress(KeyboardInterrupt), ExitStack() as stack:
        ports = [stack.enter_context(PortLink(Path(link))) for link in sys.argv[1:]]
        if ports:
            serve(ports)


if __name__ == '__main__':
    main()
