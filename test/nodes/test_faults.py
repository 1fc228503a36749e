# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What goes wrong on robots, what each of it costs, and that nothing else is lost."""

import os
import signal
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import PATIENCE_S, STAMP_ERROR_S, Sensor, check_corruption, wait_for_readings
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_ns, to_time
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.description import Scene
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.resources import shared_file

NAMESPACE = '/faults'
CLOCK = '/faults/clock'


class Chain:
    """Driver and detector under test, whoever hears them, and a sensor."""

    def __init__(self, processes: ProcessGroup, listener: Listener, sensor: Sensor) -> None:
        self.processes = processes
        self.listener = listener
        self.sensor = sensor
        self.statuses: defaultdict[str, list[DiagnosticStatus]] = defaultdict(list)
        listener.node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, 10)

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name.startswith(NAMESPACE):
                self.statuses[status.name.removeprefix(f'{NAMESPACE}/')].append(status)

    def wait(self, done: Callable[[], bool], what: str) -> None:
        assert self.listener.spin_until(done, PATIENCE_S), f'waited in vain for {what}'

    def value(self, name: str, key: str) -> int:
        """Return a number of the next diagnostics of a node."""
        told = len(self.statuses[name])
        self.wait(lambda: len(self.statuses[name]) > told, f'diagnostics of {name}')
        values = {value.key: value.value for value in self.statuses[name][-1].values}
        return int(values[key])

    def sequences(self, since: int = 0) -> list[int]:
        return [message.sequence for message, _ in self.listener.frames[since:]]

    def expect_all(self, first: int) -> None:
        """Check that every frame sent from `first` on has come, once and in order."""
        last = max(self.sensor.middle_ns)
        self.wait(lambda: last in self.sequences(), f'frame {last}')
        came = [sequence for sequence in self.sequences() if first <= sequence <= last]
        sent = [sequence for sequence in sorted(self.sensor.middle_ns) if first <= sequence <= last]
        assert came == sent

    def pass_time(self, duration_s: float) -> None:
        self.listener.spin_until(lambda: False, duration_s)

    def read_all(self, scene: Scene) -> None:
        self.listener.markers.clear()
        wait_for_readings(self.listener, {marker.id for marker in scene.markers})

    def start(self, node: str, port: Path) -> None:
        command = [executable(node), '--ros-args', '-r', f'__ns:={NAMESPACE}']
        command += ['--params-file', str(shared_file('config/retrolidar.yaml'))]
        self.processes.start(node, [*command, '-p', f'serial_port:={port}'])

    def kill(self, node: str) -> None:
        os.kill(self.processes.pid(node), signal.SIGKILL)
        self.processes.stop(node)


@pytest.fixture(scope='module')
def scene() -> Scene:
    return load_scene('coffee')


@pytest.fixture(scope='module')
def port(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('faults') / 'port'


@pytest.fixture(scope='module')
def chain(scene: Scene, port: Path) -> Iterator[Chain]:
    listener = Listener(NAMESPACE)
    with ProcessGroup(port.parent) as processes, Sensor(scene, port) as sensor:
        chain = Chain(processes, listener, sensor)
        chain.start('driver', port)
        chain.start('detector', port)
        chain.wait(listener.is_connected, 'driver and detector')
        chain.read_all(scene)
        yield chain
        processes.check()
    listener.close()


def test_a_cable_pulled_for_ten_seconds_costs_the_frames_of_that_time(
    chain: Chain, scene: Scene
) -> None:
    frames, restarts = len(chain.listener.frames), chain.value('driver: frames', 'clock restarts')
    first = chain.sequences()[-1]
    chain.sensor.pull()
    told = len(chain.statuses['driver: frames'])
    chain.pass_time(10.0)
    assert len(chain.listener.frames) - frames < 200
    levels = [status.level for status in chain.statuses['driver: frames'][told + 1 :]]
    assert levels.count(DiagnosticStatus.ERROR) >= 7
    silent = chain.statuses['detector: markers'][-1]
    assert silent.level == DiagnosticStatus.STALE
    chain.sensor.plug()
    back = len(chain.listener.frames)
    chain.wait(lambda: len(chain.listener.frames) > back + 50, 'frames')
    chain.expect_all(first)
    # The clocks went on meanwhile, so the map still holds: the first stamps are right at once.
    assert chain.value('driver: frames', 'clock restarts') == restarts
    for message, _ in chain.listener.frames[back:]:
        error_s = (to_ns(message.header.stamp) - chain.sensor.middle_ns[message.sequence]) * 1e-9
        assert abs(error_s) < STAMP_ERROR_S
    chain.read_all(scene)


def test_a_sensor_that_restarts_costs_nothing_but_what_a_packet_had_so_far(
    chain: Chain, scene: Scene
) -> None:
    restarts = chain.value('driver: frames', 'clock restarts')
    lost = chain.value('driver: frames', 'lost frames')
    before = len(chain.listener.frames)
    chain.sensor.restart()
    chain.wait(lambda: 0 in chain.sequences(before), 'the first frame')
    begin = before + chain.sequences(before).index(0)
    chain.wait(lambda: len(chain.listener.frames) > begin + 100, 'frames')
    assert chain.sequences(begin) == list(range(len(chain.listener.frames) - begin))
    assert chain.value('driver: frames', 'clock restarts') == restarts + 1
    assert chain.value('driver: frames', 'lost frames') == lost
    stamps = [to_ns(message.header.stamp) for message, _ in chain.listener.frames[before:]]
    assert stamps == sorted(set(stamps))
    for message, _ in chain.listener.frames[begin : begin + 100]:
        error_s = (to_ns(message.header.stamp) - chain.sensor.middle_ns[message.sequence]) * 1e-9
        assert abs(error_s) < STAMP_ERROR_S
    del chain.listener.frames[:begin]  # sequences that come again
    chain.read_all(scene)


def test_garbage_in_thirty_percent_of_the_bytes_costs_the_packets_it_hits(
    chain: Chain, scene: Scene
) -> None:
    check_corruption(chain.listener, chain.sensor, 0.3)
    chain.sensor.corrupt_share = 0.3
    chain.read_all(scene)  # while it lasts
    chain.sensor.corrupt_share = 0.0


def test_half_of_the_frames_lost_are_counted_and_cost_time(chain: Chain, scene: Scene) -> None:
    lost = chain.value('driver: frames', 'lost frames')
    first = chain.sequences()[-1] + 1
    chain.sensor.lost_share = 0.5
    chain.read_all(scene)  # more packets are needed, but all markers are still read
    chain.wait(lambda: chain.sequences()[-1] > first + 150, 'frames')
    chain.sensor.lost_share = 0.0
    last = max(chain.sensor.middle_ns) + 5
    chain.wait(lambda: chain.sequences()[-1] > last, 'frames')
    chain.expect_all(first)
    gone = chain.sequences()[-1] - first + 1 - len([s for s in chain.sequences() if s >= first])
    assert gone > 40
    assert chain.value('driver: frames', 'lost frames') - lost >= gone


def test_a_subscriber_that_never_reads_costs_nobody_anything(chain: Chain) -> None:
    first = chain.sequences()[-1]
    deaf = Node('deaf', namespace=NAMESPACE, context=chain.listener.node.context)
    try:
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        deaf.create_subscription(FrameMsg, 'frames', lambda _: None, reliable)
        name = f'{NAMESPACE}/frames'
        chain.wait(lambda: deaf.count_subscribers(name) > 2, 'the deaf subscriber')
        chain.pass_time(5.0)
        chain.expect_all(first)
    finally:
        deaf.destroy_node()


@pytest.mark.parametrize('node', ['detector', 'driver'])
def test_a_node_that_is_killed_costs_what_it_would_have_said(
    chain: Chain, scene: Scene, port: Path, node: str
) -> None:
    first = chain.sequences()[-1]
    chain.kill(node)
    killed = len(chain.listener.frames)
    chain.pass_time(1.0)
    chain.start(node, port)
    began = time.monotonic()
    chain.wait(lambda: len(chain.listener.frames) > killed + 100, 'frames')
    if node == 'detector':
        chain.expect_all(first)
    else:
        assert time.monotonic() - began < 10.0
        chain.expect_all(chain.sequences()[-50])
    chain.read_all(scene)


def test_a_host_clock_that_is_set_costs_no_frame(scene: Scene, tmp_path: Path) -> None:
    """The clock is that of ROS: with use_sim_time it is this test that sets it."""
    listener = Listener('/stepped')
    clock = listener.node.create_publisher(Clock, CLOCK, 10)
    step_ns = 0
    listener.node.create_timer(
        0.005, lambda: clock.publish(Clock(clock=to_time(time.time_ns() + step_ns)))
    )
    port = tmp_path / 'port'
    command = ['--ros-args', '-r', '__ns:=/stepped', '-r', f'/clock:={CLOCK}']
    command += ['-p', 'use_sim_time:=true', '-p', f'serial_port:={port}']
    try:
        with ProcessGroup(tmp_path) as processes, Sensor(scene, port) as sensor:
            for node in ('driver', 'detector'):
                processes.start(node, [executable(node), *command])
            assert listener.spin_until(lambda: len(listener.frames) > 100, PATIENCE_S)
            for step_s in (-5.0, 8.0):
                before, step_ns = len(listener.frames), round(step_s * 1e9)

                def enough_came(needed: int = before + 250) -> bool:
                    return len(listener.frames) > needed

                assert listener.spin_until(enough_came, PATIENCE_S)
                listener.markers.clear()
                wait_for_readings(listener, {marker.id for marker in scene.markers})
                # A step forward is told from a transport that stalls after a second.
                for message, _ in listener.frames[before + 100 : before + 250]:
                    true_ns = sensor.middle_ns[message.sequence] + step_ns
                    assert abs(to_ns(message.header.stamp) - true_ns) * 1e-9 < STAMP_ERROR_S
            sequences = [message.sequence for message, _ in listener.frames]
            assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
    finally:
        listener.close()
