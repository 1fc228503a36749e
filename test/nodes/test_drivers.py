# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A driver is told to start, stop and reset the sensor, reads a board of ST, or several sensors."""

import re
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from harness import Sensor, check_detections, check_frames, wait_for_readings
from harness_observer import COFFEE_IDS, System, running, values_of
from lifecycle_msgs.msg import Transition
from st_board import Board, Zone

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.nodes.driver_health import DriverTally
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.scene.emulator import VERSION, PortLink
from retrolidar_ros.sensor.clock import ClockMap
from retrolidar_ros.sensor.serial_source import SerialSource
from retrolidar_ros.sensor.wire import FrameReader, WireCounts

STATUS = 'driver: frames'
STOPPED = 'the sensor is stopped: call ~/start'


@pytest.fixture
def system(tmp_path: Path) -> Iterator[System]:
    with running(tmp_path, '/services') as system:
        yield system


def plug(system: System) -> None:
    """Start an emulated sensor that knows commands."""
    command = [executable('retrolidar'), 'emulate', 'coffee', '--port-link', str(system.port)]
    system.processes.start('sensor', command)
    system.started.append('sensor')


def change(system: System, transition: int) -> None:
    assert system.services.change_state('driver', transition)


def wait_for_more(system: System) -> None:
    system.wait_for_frames(len(system.frames) + 5)


def test_firmware_with_commands_identifies_itself_and_obeys(system: System) -> None:
    plug(system)
    system.start('driver', serial_port=system.port)
    wait_for_more(system)
    serial = sha256(str(system.port).encode()).hexdigest()[:24]
    status = system.wait_for_status(STATUS, DiagnosticStatus.OK, 'frames a second')
    assert status.hardware_id == serial
    assert values_of(status)['firmware'] == VERSION
    told = f'{system.port}: firmware {VERSION}, serial number {serial}'
    assert len(re.findall(rf'\[INFO\].*{re.escape(told)}', system.log('driver'))) == 1

    assert system.services.trigger('driver/stop') == (True, 'the sensor is stopped')
    system.wait_for_status(STATUS, DiagnosticStatus.WARN, STOPPED)
    seen = len(system.frames)
    assert system.next_status(STATUS).message == STOPPED
    assert len(system.frames) == seen
    assert system.services.trigger('driver/stop') == (True, 'the sensor is stopped')

    # The cable is pulled: a sensor that comes back ranges, and is stopped again.
    system.stop('sensor')
    system.wait_for_status(STATUS, DiagnosticStatus.ERROR, 'does not exist')
    success, message = system.services.trigger('driver/start')
    assert not success
    assert 'does not exist; is the sensor plugged in?' in message
    plug(system)
    system.wait_for_status(STATUS, DiagnosticStatus.WARN, STOPPED)

    last = max(message.sequence for message, _ in system.frames)
    assert system.services.trigger('driver/start') == (True, 'the sensor is ranging')
    wait_for_more(system)
    assert system.services.trigger('driver/reset') == (True, 'the sensor restarts')
    seen = len(system.frames)
    wait_for_more(system)
    assert min(message.sequence for message, _ in system.frames[seen:]) < max(last, 3)
    system.wait_for_status(STATUS, DiagnosticStatus.OK, 'frames a second')
    stamps = [to_ns(message.header.stamp) for message, _ in system.frames]
    assert stamps == sorted(set(stamps))


def test_the_log_says_once_why_an_open_port_gives_no_frames(system: System) -> None:
    with PortLink(system.port) as port:
        system.start('driver', serial_port=system.port)
        system.wait(lambda: 'nothing comes: is the sensor' in system.log('driver'), 'a warning')
        noise = system.node.create_timer(0.05, lambda: port.write(b'noise\0'))
        system.wait(lambda: 'another baud rate or protocol?' in system.log('driver'), 'another')
        for _ in range(2):
            system.next_status(STATUS)
        system.node.destroy_timer(noise)
        assert system.log('driver').count('[WARN]') == 2  # /diagnostics repeats them


def test_what_comes_while_a_driver_is_examined_is_told_the_next_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Bytes come in a thread of their own, at any moment; here they come when they are counted."""
    source = SerialSource('port', 9600, FrameReader())
    source.is_open = True
    received: list[int] = []

    def count(_: SerialSource) -> WireCounts:
        received.append(10 * sum(received) + 1)
        return WireCounts(bytes=received[-1])

    monkeypatch.setattr(SerialSource, 'received', property(count))
    tally = DriverTally()
    told = [tally.examine(source, ClockMap()).problems[0][1] for _ in range(3)]
    assert sum(int(one.split()[4]) for one in told) == received[-1]


def test_each_state_of_the_life_cycle(system: System) -> None:
    plug(system)
    system.start('driver', serial_port=system.port, autostart='false')
    assert system.services.trigger('driver/stop') == (False, 'not configured: the port is closed')
    change(system, Transition.TRANSITION_CONFIGURE)
    system.wait_for_status(STATUS, DiagnosticStatus.WARN, 'not active')
    assert system.services.trigger('driver/stop') == (True, 'the sensor is stopped')
    change(system, Transition.TRANSITION_ACTIVATE)
    system.wait_for_status(STATUS, DiagnosticStatus.WARN, STOPPED)
    assert not system.frames
    # What it cannot do from here is refused, and it lives on.
    assert not system.services.change_state('driver', Transition.TRANSITION_CONFIGURE)
    # Configuring it anew starts the sensor, also while the cable is out.
    system.stop('sensor')
    change(system, Transition.TRANSITION_DEACTIVATE)
    change(system, Transition.TRANSITION_CLEANUP)
    system.wait_for_status(STATUS, DiagnosticStatus.WARN, 'not configured')
    change(system, Transition.TRANSITION_CONFIGURE)
    plug(system)
    change(system, Transition.TRANSITION_ACTIVATE)
    wait_for_more(system)
    change(system, Transition.TRANSITION_DEACTIVATE)
    system.wait_for_status(STATUS, DiagnosticStatus.WARN, 'not active')
    seen = len(system.frames)
    system.next_status(STATUS)
    assert len(system.frames) == seen
    change(system, Transition.TRANSITION_ACTIVATE)
    wait_for_more(system)
    change(system, Transition.TRANSITION_ACTIVE_SHUTDOWN)
    system.wait_for_status(STATUS, DiagnosticStatus.WARN, 'finalized')


def test_text_is_published_as_frames(tmp_path: Path) -> None:
    zones: list[Zone | None] = [None] * 16
    zones[3] = Zone(700, signal_kcps=250, ambient_kcps=4)  # at the scene's top left
    with (
        Board(zones) as board,
        running(tmp_path, '/kit') as system,
        system.subscribed(FrameMsg, 'frames') as messages,
    ):
        system.start('driver', serial_port=board.path, protocol='st_example')
        with board.printing():
            system.wait(lambda: sum(one.signal[0] > 0 for one in messages) > 30, 'frames')
            values = values_of(system.next_status('driver: frames'))
        reset = system.services.trigger('driver/reset')
        assert reset == (False, 'this protocol has no commands')
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
    assert int(values['frames']) >= 30
    assert values['clock restarts'] == '0'


def test_many_sensors_are_read_in_one_process(tmp_path: Path) -> None:
    names, coffee = ['left', 'right'], load_scene('coffee')
    ports = [tmp_path / name for name in names]
    left, right = (Listener(f'/many/{name}') for name in names)
    with (
        running(tmp_path, '/many') as system,
        Sensor(coffee, ports[0]) as sensor,
        Sensor(load_scene('drone'), ports[1]),
    ):
        system.start('reader', ports=[str(path) for path in ports], names=names)
        wait_for_readings(left, COFFEE_IDS)
        check_frames(left, sensor, 'left_optical_frame')
        check_detections(left, coffee, 'left_optical_frame', name='left_marker_{0.id}')
        wait_for_readings(right, {2127})
        (message, _), *_ = right.markers
        assert message.header.frame_id == 'right_optical_frame'
        assert message.child_frame_id == 'right_marker_2127'
    left.close()
    right.close()
