# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The real executables over a real pseudo-terminal and real DDS."""

import os
import re
import signal
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

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
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from st_board import Board, Zone

from retrolidar_ros.cli.demo import NAMESPACE, executable, start_nodes
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.detector.reason import Reason
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_frame_msg, to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import Scene
from retrolidar_ros.scene.files import load_scene

FRAME_ID = 'retrolidar_optical_frame'
DRIVER = f'{NAMESPACE}/driver: frames'
DETECTOR = f'{NAMESPACE}/detector: markers'
Diagnostics = defaultdict[str, list[DiagnosticStatus]]


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
def diagnostics(listener: Listener) -> Diagnostics:
    """Collect what the nodes say of themselves, by name."""
    heard: Diagnostics = defaultdict(list)

    def take(message: DiagnosticArray) -> None:
        for status in message.status:
            heard[status.name].append(status)

    listener.node.create_subscription(DiagnosticArray, '/diagnostics', take, 10)
    return heard


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


@pytest.fixture(scope='module')
def sensor(
    scene: Scene, port: Path, listener: Listener, diagnostics: Diagnostics
) -> Iterator[Sensor]:
    """Start the nodes, wait until they are there, and plug in a sensor."""
    with ProcessGroup(port.parent) as processes:
        start_nodes(processes, port)
        wait_for_nodes(listener)
        assert listener.spin_until(lambda: {DRIVER, DETECTOR} <= set(diagnostics), 5.0)
        with Sensor(scene, port) as sensor:
            yield sensor
        processes.check()


def test_an_absent_port_is_said_and_waited_for(
    sensor: Sensor, diagnostics: Diagnostics, port: Path
) -> None:
    first = diagnostics[DRIVER][0]
    assert first.level == DiagnosticStatus.ERROR
    assert f'{port} does not exist' in first.message


def test_frames_and_detections_are_as_they_should_be(
    sensor: Sensor, listener: Listener, scene: Scene
) -> None:
    wait_for_readings(listener, {marker.id for marker in scene.markers})
    check_frames(listener, sensor, FRAME_ID)
    check_detections(listener, scene, FRAME_ID)


def test_the_detector_says_what_became_of_candidates(
    sensor: Sensor, listener: Listener, diagnostics: Diagnostics
) -> None:
    first = diagnostics[DETECTOR][0]
    assert first.level == DiagnosticStatus.WARN
    assert first.message == 'no frame has come yet'
    latest = len(diagnostics[DETECTOR])
    assert listener.spin_until(
        lambda: any(
            status.level == DiagnosticStatus.OK for status in diagnostics[DETECTOR][latest:]
        ),
        5.0,
    )
    status = diagnostics[DETECTOR][-1]
    values = values_of(status)
    assert values['method'] == 'joint'
    assert int(values['frames']) > 20
    assert 3 <= int(values['accepted']) <= int(values['candidates'])
    reasons = [key for key in values if key.startswith('rejected: ')]
    refused = sum(int(values[reason]) for reason in reasons)
    assert int(values['accepted']) + refused >= int(values['candidates'])


def test_the_detector_is_stale_while_no_frames_come(
    sensor: Sensor, listener: Listener, diagnostics: Diagnostics
) -> None:
    sensor.pull()
    silent = len(diagnostics[DETECTOR])
    assert listener.spin_until(
        lambda: any(
            status.level == DiagnosticStatus.STALE
            and status.message.startswith('no frame has come for ')
            for status in diagnostics[DETECTOR][silent:]
        ),
        5.0,
    )
    sensor.plug()


def test_an_empty_list_is_a_value_like_any_other(sensor: Sensor, listener: Listener) -> None:
    client = listener.node.create_client(GetParameters, f'{NAMESPACE}/detector/get_parameters')
    assert client.wait_for_service(5.0)
    future: Any = client.call_async(GetParameters.Request(names=['registered_ids', 'method']))
    assert listener.spin_until(future.done, 5.0)
    ids, method = future.result().values
    assert ids.type == ParameterType.PARAMETER_INTEGER_ARRAY
    assert list(ids.integer_array_value) == []
    assert method.string_value == 'joint'


def test_a_pulled_cable_costs_two_seconds_at_most(sensor: Sensor, listener: Listener) -> None:
    check_cable_pull(listener, sensor)


def test_damaged_bytes_cost_their_own_packets_only(
    sensor: Sensor, listener: Listener, diagnostics: Diagnostics
) -> None:
    check_corruption(listener, sensor, 0.05)

    def damage_counted() -> bool:
        values = values_of(diagnostics[DRIVER][-1])
        errors = int(values['packets with CRC errors']) + int(values['packets with framing errors'])
        return errors >= len(sensor.damaged)

    assert listener.spin_until(damage_counted, 5.0)
    recovered = len(diagnostics[DRIVER])
    assert listener.spin_until(
        lambda: any(
            status.level == DiagnosticStatus.OK for status in diagnostics[DRIVER][recovered:]
        ),
        5.0,
    )


def test_markers_are_still_read_afterwards(
    sensor: Sensor, listener: Listener, scene: Scene
) -> None:
    listener.markers.clear()
    wait_for_readings(listener, {marker.id for marker in scene.markers})


@pytest.mark.parametrize(
    ('node', 'parameter', 'message'),
    [
        ('detector', 'method:=magic', "method: 'magic' is not one of joint, paper"),
        ('detector', 'bit_period:=-1.0', 'bit_period'),
        ('detector', 'max_packets:=9', 'max_packets'),
        ('detector', 'noise_floor:=0.0', 'noise_floor'),
        ('detector', 'registered_ids:=[7,5000]', 'registered_ids: 5000 is not within 0 to 4095'),
        ('detector', 'registered_ids:=[0]', 'registered_ids holds no usable ID'),
        ('detector', 'registered_ids:=7', 'registered_ids'),
        ('driver', 'serial_baud:=fast', 'serial_baud'),
        ('driver', 'protocol:=magic', "protocol: 'magic' is not one of retrolidar, st_example"),
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


def test_frames_that_do_not_suit_the_bits_are_warned_of_once(
    scene: Scene, listener: Listener, diagnostics: Diagnostics
) -> None:
    process = subprocess.Popen(
        [executable('detector'), '--ros-args', '-r', '__ns:=/slow', '-p', 'bit_period:=0.03'],
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        publisher = listener.node.create_publisher(FrameMsg, '/slow/frames', 10)
        assert listener.spin_until(lambda: publisher.get_subscription_count() > 0, 30.0)

        def enough_came() -> bool:
            heard = diagnostics['/slow/detector: markers']
            return bool(heard) and int(values_of(heard[-1])['frames']) > 50

        # A busy machine may lose some frames: as many are sent as it takes.
        for frame in Simulation(scene).run(60.0):
            publisher.publish(to_frame_msg(frame, FRAME_ID))
            if listener.spin_until(enough_came, 0.005):
                break
        assert enough_came()
    finally:
        process.terminate()
        _, errors = process.communicate(timeout=10)
    (line,) = (line for line in errors.splitlines() if 'a frame comes every' in line)
    assert 'WARN' in line
    assert re.search(r'a frame comes every 2[01]\.\d ms, but bit_period is 30\.0 ms', line)


def test_every_candidate_that_is_refused_is_logged_for_debugging(
    scene: Scene, listener: Listener, diagnostics: Diagnostics, tmp_path: Path
) -> None:
    name = '/refused/detector: markers'
    command = [executable('detector'), '--ros-args', '-r', '__ns:=/refused']
    log = tmp_path / 'log'
    with log.open('w') as errors:
        process = subprocess.Popen([*command, '--log-level', 'debug'], stderr=errors)
        try:
            publisher = listener.node.create_publisher(FrameMsg, '/refused/frames', 10)
            assert listener.spin_until(lambda: publisher.get_subscription_count() > 0, 30.0)

            def is_refused() -> bool:
                heard = diagnostics[name]
                return bool(heard) and any('rejected' in key for key in values_of(heard[-1]))

            for frame in Simulation(scene).run(60.0):
                publisher.publish(to_frame_msg(frame, FRAME_ID))
                if listener.spin_until(is_refused, 0.005):
                    break
            assert is_refused()
        finally:
            process.terminate()
            process.wait(10)
    reasons = '|'.join(reason.value for reason in Reason)
    logged = re.findall(
        rf'refused: ({reasons}): ID \d+, evidence \S+, word \S+, margin \S+ nats', log.read_text()
    )
    counted = sum(
        int(count) for key, count in values_of(diagnostics[name][-1]).items() if 'rejected' in key
    )
    assert len(logged) >= counted > 0


def test_the_text_of_the_example_is_published_and_its_period_warned_of(
    listener: Listener, diagnostics: Diagnostics
) -> None:
    messages: list[FrameMsg] = []
    subscription = listener.node.create_subscription(FrameMsg, '/kit/frames', messages.append, 100)
    zones: list[Zone | None] = [None] * 16
    zones[3] = Zone(700, signal_kcps=250, ambient_kcps=4)  # at the scene's top left
    health = diagnostics['/kit/driver: frames']
    stop = threading.Event()
    with Board(zones) as board:
        command = [executable('driver'), '--ros-args', '-r', '__ns:=/kit']
        command += ['-p', f'serial_port:={board.path}', '-p', 'protocol:=st_example']
        process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        printing = threading.Thread(target=board.run, args=(stop, 0.05))
        printing.start()
        try:
            assert listener.spin_until(
                lambda: sum(message.signal[0] > 0 for message in messages) > 30, 30.0
            )
            heard = len(health)
            assert listener.spin_until(lambda: len(health) > heard, 5.0)
        finally:
            stop.set()
            printing.join()
            process.terminate()
            _, errors = process.communicate(timeout=10)
            listener.node.destroy_subscription(subscription)
        assert board.keys == b's'
    lit = [message.signal[0] > 0 for message in messages]
    assert lit == sorted(lit)  # once switched on, it stays on
    for message in messages:
        assert (message.rows, message.columns) == (4, 4)
        assert message.distance[0] == pytest.approx(0.7)
        assert list(message.status) == [5] + [255] * 15
    assert (messages[-1].signal[0], messages[-1].ambient[0]) == (250, 4)
    stamps = [to_ns(message.header.stamp) for message in messages]
    assert stamps == sorted(set(stamps))
    values = values_of(health[-1])
    assert int(values['frames']) >= 30
    assert values['clock restarts'] == '0'
    warning, *_ = (line for line in errors.splitlines() if "ST's example sends" in line)
    assert 'WARN' in warning
    told = re.search(r'sends a frame every (\d+) ms.* bit_period to ([\d.]+\d)', warning)
    assert told  # how long a busy machine takes is not to be foreseen
    assert float(told[2]) == pytest.approx(int(told[1]) * 2e-3, abs=2e-3)


def test_text_to_a_driver_that_expects_packets_is_told(
    listener: Listener, diagnostics: Diagnostics
) -> None:
    health = diagnostics['/text/driver: frames']
    stop = threading.Event()
    with Board([Zone(700)] * 16) as board:
        command = [executable('driver'), '--ros-args', '-r', '__ns:=/text']
        command += ['-p', f'serial_port:={board.path}']
        process = subprocess.Popen(command)
        printing = threading.Thread(target=board.run, args=(stop, 0.05))

        def told(pattern: str) -> bool:
            return any(re.fullmatch(pattern, status.message) for status in health)

        silence = 'the port is open, but no frames come'
        try:
            assert listener.spin_until(lambda: told(silence), 30.0)
            printing.start()
            told_of = rf'{silence}, though \d+ bytes did: another serial_baud or protocol\?'
            assert listener.spin_until(lambda: told(told_of), 10.0)
        finally:
            stop.set()
            if printing.ident is not None:
                printing.join()
            process.terminate()
            process.wait(10)


SPY = """
import os, runpy, sys

class Spy:
    def find_spec(self, name, path=None, target=None):
        if name == 'numpy':
            print('threads:', os.environ.get('OPENBLAS_NUM_THREADS'))

sys.meta_path.insert(0, Spy())
runpy.run_path(sys.argv[1], run_name='__main__')
"""


@pytest.mark.parametrize(
    ('name', 'arguments'),
    [
        ('driver', ['--ros-args', '-p', "frame_id:=''"]),
        ('detector', ['--ros-args', '-p', 'method:=magic']),
        ('retrolidar', ['decode', 'nowhere']),
    ],
)
def test_numpy_is_told_to_use_one_thread_before_it_is_imported(
    name: str, arguments: list[str], tmp_path: Path
) -> None:
    environment = {key: value for key, value in os.environ.items() if 'NUM_THREADS' not in key}
    result = subprocess.run(
        [sys.executable, '-c', SPY, executable(name), *arguments],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
        env=environment,
        cwd=tmp_path,  # here would be the sources, without the messages
    )
    assert result.returncode == 2
    assert result.stdout.splitlines()[0] == 'threads: 1'
