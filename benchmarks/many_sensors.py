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
from dataclasses import replace
from itertools import count
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.scene.emulator import PortLink
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.wire import encode_frame
from retrolidar_ros.settings.files import shared_file

SCENE = load_scene('coffee')
PERIOD_S = SCENE.sensor.period_s
REPLAY_S = 60.0  # packets are cut where the replay begins again, so that should be rare
TIMEOUT_S = 120.0


def replayed(frames: Sequence[Frame], first: int) -> Iterator[tuple[float, bytes]]:
    """Yield the packets of frames over and over from one on; sequence and sensor time go on.

    With each packet comes the time since the first [s].
    """
    turn_us = frames[-1].sensor_time_us - frames[0].sensor_time_us + round(PERIOD_S * 1e6)
    for sequence in count():
        turn, index = divmod(first + sequence, len(frames))
        time_us = turn * turn_us + frames[index].sensor_time_us
        frame = replace(frames[index], sequence=sequence, sensor_time_us=time_us)
        yield 1e-6 * (time_us - frames[first].sensor_time_us), encode_frame(frame)


def serve(ports: Sequence[PortLink]) -> None:
    """Send the packets of all sensors when they are due."""
    frames = list(Simulation(SCENE).run(REPLAY_S))
    # Each begins at another time of the scene.
    firsts = [index * len(frames) // len(ports) for index in range(len(ports))]
    sensors = [replayed(frames, first) for first in firsts]
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
        self.ports = [str(directory / f'port{index}') for index in range(number)]
        self._nodes: list[str] = []

    def start_pairs(self) -> None:
        """Start a driver and a detector for each sensor, as `demo` does, and wait for them."""
        for namespace, port in zip(self.namespaces, self.ports, strict=True):
            self._start('driver', namespace, '-p', f'serial_port:={port}')
            self._start('detector', namespace)
        topics = [f'{one}/{topic}' for one in self.namespaces for topic in ('frames', 'markers')]

        def are_there() -> bool:
            self._processes.check()
            return all(listener.node.count_publishers(topic) for topic in topics)

        # By a node that is there no longer than this takes.
        with closing(Listener('/start')) as listener:
            if not listener.spin_until(are_there, TIMEOUT_S):
                raise TimeoutError(f'nobody publishes some of {", ".join(topics)}')

    def start_reader(self) -> None:
        """Start one process that reads all sensors."""
        self._start('reader', '/hall', '-p', f'ports:={self.ports}')

    def plug_in(self) -> None:
        """Start the sensors."""
        self._processes.start('sensors', [sys.executable, __file__, *self.ports])

    def pids(self) -> list[int]:
        """Return the process IDs of all nodes."""
        return [self._processes.pid(name) for name in self._nodes]

    def _start(self, node: str, namespace: str, *arguments: str) -> None:
        common = ['--ros-args', '--params-file', str(shared_file('config/retrolidar.yaml'))]
        command = [executable(node), *common, '-r', f'__ns:={namespace}', *arguments]
        self._nodes.append(f'{node}_{namespace[1:]}')
        self._processes.start(self._nodes[-1], command)


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
