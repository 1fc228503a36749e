# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Many emulated sensors, and their nodes.

embedded/run python benchmarks/many_sensors.py LINK...

As a program it is the sensors: at each link one of them replays the scene `coffee` in real time,
until the program is interrupted. One process serves them all, from frames computed beforehand, to
leave the processor to the nodes.
"""

from __future__ import annotations

import heapq
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, suppress
from itertools import count
from pathlib import Path
from struct import Struct

from diagnostic_msgs.msg import DiagnosticArray

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
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
_COUNTERS = Struct('<IQ')  # sequence and sensor time, which follow the kind
_KIND_BYTES = 1
_CRC_BYTES = 2


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
    """Send the packets of all sensors when they are due."""
    sensors = Replay(SCENE).sensors(len(ports))
    now_s = time.monotonic()
    # Nobody synchronises sensors, so they are spread over the frame period, too.
    starts_s = [now_s + index * PERIOD_S / len(ports) for index in range(len(ports))]
    due = [(starts_s[index], index, next(sensor)[1]) for index, sensor in enumerate(sensors)]
    while True:
        due_s, index, packet = due[0]
        time.sleep(max(0.0, due_s - time.monotonic()))
        ports[index].write(packet)
        since_s, packet = next(sensors[index])
        heapq.heapreplace(due, (starts_s[index] + since_s, index, packet))


class Sensors:
    """Sensors, and the nodes that read them: pairs of driver and detector, or one reader."""

    def __init__(self, processes: ProcessGroup, directory: Path, number: int) -> None:
        """Choose ports in a directory, and namespaces."""
        self.namespaces = [f'/sensor{index}' for index in range(number)]
        self._processes = processes
        self._ports = [str(directory / f'port{index}') for index in range(number)]
        self._nodes: list[str] = []

    def start_pairs(self) -> None:
        """Start a driver and a detector for each sensor, as `demo` does, and wait for them."""
        for namespace, port in zip(self.namespaces, self._ports, strict=True):
            self._start('driver', namespace, '-p', f'serial_port:={port}')
            self._start('detector', namespace)
        self._wait_for(
            [f'{one}/{topic}' for one in self.namespaces for topic in ('frames', 'markers')]
        )

    def start_reader(self) -> None:
        """Start one process that reads all sensors."""
        self._start('reader', '/hall', '-p', f'ports:={self._ports}')

    def plug_in(self) -> None:
        """Start the sensors."""
        self._processes.start('sensors', [sys.executable, __file__, *self._ports])

    def pids(self) -> list[int]:
        """Return the process IDs of all nodes."""
        return [self._processes.pid(name) for name in self._nodes]

    def start_second(self) -> None:
        """Start one more detector, for the frames of the first sensor, and wait for it."""
        self._start('detector', '/second', '-r', f'frames:={self.namespaces[0]}/frames')
        self._wait_for(['/second/markers'])

    def stop_second(self) -> None:
        """Stop the detector that was added."""
        self._processes.stop(self._nodes.pop())

    def _start(self, node: str, namespace: str, *arguments: str) -> None:
        common = ['--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))]
        command = [executable(node), *common, '-r', f'__ns:={namespace}', *arguments]
        self._nodes.append(f'{node}_{namespace[1:]}')
        self._processes.start(self._nodes[-1], command)

    def _wait_for(self, topics: Sequence[str]) -> None:
        """Wait for publishers, by a node that is there no longer than this takes."""

        def are_there() -> bool:
            self._processes.check()
            return all(listener.node.count_publishers(topic) for topic in topics)

        with closing(Listener('/start')) as listener:
            if not listener.spin_until(are_there, TIMEOUT_S):
                raise TimeoutError(f'nobody publishes some of {", ".join(topics)}')


class FrameCounter(Listener):
    """Takes note of how many frames nodes say they have taken and lost."""

    def __init__(self) -> None:
        """Join the graph, in a namespace without nodes: no frames cross to it."""
        super().__init__('/elsewhere')
        self.taken: dict[str, int] = {}
        """By each detector."""
        self.lost: dict[str, int] = {}
        """Missing between those that each driver or detector got."""
        self.node.create_subscription(DiagnosticArray, '/diagnostics', self._count, 1000)

    def _count(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            if 'frames' in values:  # else not configured
                self.lost[status.name] = int(values['lost frames'])
                if not status.name.partition(':')[0].endswith('/driver'):
                    self.taken[status.name] = int(values['frames'])


def main() -> None:
    """Serve the links that the command line names."""
    with suppress(KeyboardInterrupt), ExitStack() as stack:
        ports = [stack.enter_context(PortLink(Path(link))) for link in sys.argv[1:]]
        if ports:
            serve(ports)


if __name__ == '__main__':
    main()
