# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Running nodes: how tests start, feed, question and end them, and what the nodes report."""

import itertools
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import rclpy
from harness import wait_for_readings
from harness_observer import Observer
from rclpy.executors import SingleThreadedExecutor

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_frame_msg
from retrolidar_ros.nodes.reader import create_nodes
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import load_scene

FRAME_ID = 'retrolidar_optical_frame'
COFFEE_IDS = {2073, 2096, 2107}


class System(Observer):
    """Nodes of a namespace, their messages and logs."""

    def __init__(self, directory: Path, namespace: str, processes: ProcessGroup) -> None:
        super().__init__(namespace)
        self.port = directory / 'port'
        self.processes = processes
        self.started: list[str] = []

    def start(
        self, node: str, *arguments: str, name: str = '', namespace: str = '', **parameters: object
    ) -> None:
        """Start a node; its process has a name of its own if there are several of a kind."""
        command = [executable(node), '--ros-args', '-r', f'__ns:={namespace or self.namespace}']
        command += arguments
        for key, value in parameters.items():
            command += ['-p', f'{key}:={value}']
        self.processes.start(name or node, command)
        self.started.append(name or node)

    def stop(self, name: str, number: signal.Signals = signal.SIGINT) -> None:
        """End a process by a signal, which must end it in order."""
        if number != signal.SIGINT:
            self.send(name, number)
        self.started.remove(name)
        assert self.processes.stop(name) == 0
        assert 'Traceback' not in self.log(name)

    def send(self, name: str, number: signal.Signals) -> None:
        """End a process by a signal of one's choice; it is left to be stopped."""
        os.kill(self.processes.pid(name), number)
        os.waitid(os.P_PID, self.processes.pid(name), os.WEXITED | os.WNOWAIT)

    def kill(self, name: str) -> None:
        """End a process by SIGKILL."""
        self.send(name, signal.SIGKILL)
        self.processes.stop(name)
        self.started.remove(name)

    def log(self, name: str) -> str:
        return self.processes.log(name).read_text()

    @contextmanager
    def fed(self, topic: str) -> Iterator[list[int]]:
        """Publish frames of the coffee scene, faster than they would come; yield their stamps."""
        simulation = Simulation(load_scene('coffee'))
        frames = itertools.chain.from_iterable(map(simulation.advance, itertools.repeat(100)))
        publisher = self.node.create_publisher(FrameMsg, topic, 10)
        self.wait(lambda: publisher.get_subscription_count() > 0, f'subscribers of {topic}')
        sent_ns: list[int] = []

        def send() -> None:
            frame = next(frames)
            sent_ns.append(frame.stamp_ns)
            publisher.publish(to_frame_msg(frame, FRAME_ID))

        feed = self.node.create_timer(0.007, send)
        try:
            yield sent_ns
        finally:
            self.node.destroy_timer(feed)
            self.node.destroy_publisher(publisher)

    def read_all(self, ids: set[int] = COFFEE_IDS) -> None:
        """Wait until each marker is read from now on."""
        self.markers.clear()
        wait_for_readings(self, ids)


@contextmanager
def running(directory: Path, namespace: str) -> Iterator[System]:
    """Open a system; what runs at the end of the block must end in order."""
    with ProcessGroup(directory) as processes:
        system = System(directory, namespace, processes)
        try:
            yield system
            processes.check()
            for name in list(system.started):
                system.stop(name)
        finally:
            system.close()


@contextmanager
def in_this_process(system: System, *arguments: str) -> Iterator[SingleThreadedExecutor]:
    """Make driver and detector in this process; a test can spin them and replace functions."""
    rclpy.init(args=['--ros-args', '-r', f'__ns:={system.namespace}', *arguments])
    executor = SingleThreadedExecutor()
    nodes = create_nodes()
    for node in nodes:
        executor.add_node(node)
    try:
        yield executor
    finally:
        executor.shutdown()
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()
