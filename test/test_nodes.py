# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The real executables over a real pseudo-terminal and real DDS."""

import os
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import (
    Sensor,
    check_cable_pull,
    check_corruption,
    check_detections,
    check_frames,
    wait_for_nodes,
    wait_for_readings,
)

from retrolidar_ros.demo import NAMESPACE, executable, start_nodes
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.processes import ProcessGroup
from retrolidar_ros.scene.description import Scene
from retrolidar_ros.yaml_files import load_scene

FRAME_ID = 'retrolidar_optical_frame'


@pytest.fixture(scope='module')
def scene() -> Scene:
    return load_scene('coffee')


@pytest.fixture(scope='module')
def port(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp('chain') / 'port'


@pytest.fixture(scope='module')
def listener() -> Iterator[Listener]:
    listener = Listener(NAMESPACE)
    yield listener
    listener.close()


@pytest.fixture(scope='module')
def diagnostics(listener: Listener) -> list[DiagnosticStatus]:
    """Collect what the driver says of itself."""
    heard: list[DiagnosticStatus] = []

    def take(message: DiagnosticArray) -> None:
        heard.extend(message.status)

    listener.node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    return heard


@pytest.fixture(scope='module')
def sensor(
    scene: Scene, port: Path, listener: Listener, diagnostics: list[DiagnosticStatus]
) -> Iterator[Sensor]:
    """Start the nodes, wait until they are there, and plug in a sensor."""
    with ProcessGroup(port.parent) as processes:
        start_nodes(processes, port)
        wait_for_nodes(listener)
        assert listener.spin_until(lambda: bool(diagnostics), 5.0)
        with Sensor(scene, port) as sensor:
            yield sensor
        processes.check()


def test_an_absent_port_is_said_and_waited_for(
    sensor: Sensor, diagnostics: list[DiagnosticStatus], port: Path
) -> None:
    first = diagnostics[0]
    assert first.name == f'{NAMESPACE}/driver: frames'
    assert first.level == DiagnosticStatus.ERROR
    assert f'{port} does not exist' in first.message


def test_frames_and_detections_are_as_they_should_be(
    sensor: Sensor, listener: Listener, scene: Scene
) -> None:
    wait_for_readings(listener, {marker.id for marker in scene.markers})
    check_frames(listener, sensor, FRAME_ID)
    check_detections(listener, scene, FRAME_ID)


def test_a_pulled_cable_costs_two_seconds_at_most(sensor: Sensor, listener: Listener) -> None:
    check_cable_pull(listener, sensor)


def test_damaged_bytes_cost_their_own_packets_only(
    sensor: Sensor, listener: Listener, diagnostics: list[DiagnosticStatus]
) -> None:
    check_corruption(listener, sensor, 0.05)

    def damage_counted() -> bool:
        values = {value.key: value.value for value in diagnostics[-1].values}
        errors = int(values['packets with CRC errors']) + int(values['packets with framing errors'])
        return errors >= len(sensor.damaged)

    assert listener.spin_until(damage_counted, 5.0)
    recovered = len(diagnostics)
    assert listener.spin_until(
        lambda: any(status.level == DiagnosticStatus.OK for status in diagnostics[recovered:]), 5.0
    )


def test_markers_are_still_read_afterwards(
    sensor: Sensor, listener: Listener, scene: Scene
) -> None:
    listener.markers.clear()
    wait_for_readings(listener, {marker.id for marker in scene.markers})


@pytest.mark.parametrize(
    ('node', 'parameter', 'message'),
    [
        ('detector', 'method:=magic', "method: 'magic' is not one of paper"),
        ('detector', 'bit_period:=-1.0', 'bit_period'),
        ('driver', 'serial_baud:=fast', 'serial_baud'),
        ('driver', "frame_id:=''", 'frame_id'),
    ],
)
def test_a_wrong_parameter_is_one_clear_line(node: str, parameter: str, message: str) -> None:
    result = subprocess.run(
        [executable(node), '--ros-args', '-p', parameter],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert result.returncode == 2
    assert message in result.stderr + result.stdout
    assert 'Traceback' not in result.stderr


@pytest.mark.parametrize('node', ['driver', 'detector'])
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_node_ends_without_a_traceback(
    node: str, number: signal.Signals, listener: Listener
) -> None:
    process = subprocess.Popen(
        [executable(node), '--ros-args', '-r', f'__ns:=/ending_{number}'],
        stderr=subprocess.PIPE,
        text=True,
    )
    name = (node, f'/ending_{number}')
    graph = listener.node.get_node_names_and_namespaces
    assert listener.spin_until(lambda: name in graph(), 30.0)
    os.kill(process.pid, number)
    _, errors = process.communicate(timeout=10)
    assert 'Traceback' not in errors
    assert process.returncode == 0
