# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What driver and detector report, what goes wrong on robots, and that nothing else is lost."""

import os
import re
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from harness import PATIENCE_S, Sensor, check_detections, check_frames, check_stamps
from harness_observer import COFFEE_IDS, FRAME_ID, System, in_this_process, running, values_of
from rclpy.clock import ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_frame_msg, to_ns, to_time
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.scene.emulator import PortLink, frames_in_real_time
from retrolidar_ros.sensor.wire import encode_frame

RECONNECT_S = 6.0  # two of the source, and the rest for a machine that is busy
DELAY_NS = 10_500_000  # from the middle of an exposure to the arrival of its frame
DRIVER, DETECTOR = 'driver: frames', 'detector: markers'
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE
SCENE = load_scene('coffee')


def sequences(system: System, since: int = 0) -> list[int]:
    return [message.sequence for message, _ in system.frames[since:]]


def expect_all(system: System, sensor: Sensor, first: int) -> None:
    """Check that every frame sent from `first` on has come, once and in order."""
    last = max(sensor.middle_ns)
    system.wait(lambda: last in sequences(system), f'frame {last}')
    came = [sequence for sequence in sequences(system) if first <= sequence <= last]
    sent = [sequence for sequence in sorted(sensor.middle_ns) if first <= sequence <= last]
    assert came == sent


@pytest.fixture(scope='module')
def sensor(tmp_path_factory: pytest.TempPathFactory) -> Sensor:
    return Sensor(SCENE, tmp_path_factory.mktemp('faults') / 'port')


@pytest.fixture(scope='module')
def system(sensor: Sensor) -> Iterator[System]:
    """Start the nodes, and then plug in the sensor."""
    with running(sensor.path.parent, '/faults') as system:
        system.start('driver', serial_port=sensor.path)
        system.start('detector')
        system.wait(lambda: {DRIVER, DETECTOR} <= set(system.statuses), 'both nodes')
        with sensor:
            system.read_all()
            yield system


def test_markers_are_read_and_placed(system: System, sensor: Sensor) -> None:
    first = system.statuses[DRIVER][0]
    assert (first.level, 'port does not exist' in first.message) == (ERROR, True)
    first = system.statuses[DETECTOR][0]
    assert (first.level, first.message) == (WARN, 'no frame has come yet')
    check_frames(system, sensor, FRAME_ID)
    check_detections(system, SCENE, FRAME_ID)
    status = system.wait_for_status(DRIVER, OK, 'frames a second')
    # This sensor knows no commands.
    assert (status.hardware_id, 'firmware' in values_of(status)) == (str(system.port), False)
    success, message = system.services.trigger('driver/stop')
    assert not success
    assert message.startswith('no answer to stop: flash a firmware')
    values = values_of(system.wait_for_status(DETECTOR, OK, 'packets accepted'))
    assert values['method'] == 'joint'
    assert int(values['frames']) > 20
    assert 3 <= int(values['accepted']) <= int(values['candidates'])
    # What is left over of packets that are subtracted may stand out a little.
    rejected = {key for key in values if key.startswith('rejected: ')}
    assert rejected <= {'rejected: evidence'}, values


def test_transforms_go_out_before_what_they_belong_to(system: System) -> None:
    """By the times at which they were sent: on the way, one topic may still overtake another."""
    sent: dict[str, dict[int, int]] = {'transforms': {}, 'markers': {}}

    def take_transforms(message: TFMessage, info: dict[str, int]) -> None:
        for one in message.transforms:
            sent['transforms'][to_ns(one.header.stamp)] = info['source_timestamp']

    def take_marker(message: MarkerDetection, info: dict[str, int]) -> None:
        sent['markers'][to_ns(message.header.stamp)] = info['source_timestamp']

    topic = f'{system.namespace}/markers'
    both = [
        system.node.create_subscription(TFMessage, '/tf', cast(Any, take_transforms), 100),
        system.node.create_subscription(MarkerDetection, topic, cast(Any, take_marker), 100),
    ]
    system.wait(lambda: len(sent['transforms'].keys() & sent['markers'].keys()) > 5, 'readings')
    for one in both:
        system.node.destroy_subscription(one)
    for stamp_ns in sent['transforms'].keys() & sent['markers'].keys():
        assert sent['transforms'][stamp_ns] < sent['markers'][stamp_ns]


def test_a_heartbeat_is_of_the_last_frame_that_was_judged(system: System) -> None:
    system.wait_for_frames(len(system.frames))
    with system.subscribed(Header, 'detector/heartbeat') as beats:
        system.wait(lambda: len(beats) > 5, 'heartbeats')
    stamps = [to_ns(beat.stamp) for beat in beats]
    assert stamps == sorted(set(stamps))
    assert {beat.frame_id for beat in beats} == {FRAME_ID}
    # Of two topics, either message may be heard first.
    system.wait(
        lambda: set(stamps) <= {to_ns(message.header.stamp) for message, _ in system.frames},
        'the frames of heartbeats',
    )


def test_a_detector_that_stands_still_is_reported_and_loses_nothing(system: System) -> None:
    pid, lost = system.processes.pid('detector'), system.number(DETECTOR, 'lost frames')
    os.kill(pid, signal.SIGSTOP)
    try:
        system.wait_for_status(DRIVER, WARN, 'the detector has judged no frame for', 2.5)
        system.wait_for_frames(len(system.frames) + 60)
    finally:
        os.kill(pid, signal.SIGCONT)
    system.wait_for_status(DETECTOR, OK, 'accepted')
    assert system.number(DETECTOR, 'lost frames') == lost
    system.wait_for_status(DRIVER, OK, 'frames a second')


def test_two_senders_of_one_frame_id_are_an_error_that_names_them(system: System) -> None:
    publisher = system.node.create_publisher(FrameMsg, 'frames', 10)
    frames = iter(Simulation(SCENE).run(60.0))

    def send() -> None:
        frame = replace(next(frames), stamp_ns=system.node.get_clock().now().nanoseconds)
        publisher.publish(to_frame_msg(frame, FRAME_ID))

    timer = system.node.create_timer(0.021, send)
    try:
        status = system.wait_for_status(DETECTOR, ERROR, 'come mixed by')
        assert '/faults/driver, /faults/listener' in status.message
        assert re.search(r': \d+ frames out of order', status.message)
    finally:
        system.node.destroy_timer(timer)
        system.node.destroy_publisher(publisher)
    system.wait_for_status(DETECTOR, OK, 'accepted')


def test_a_cable_that_is_out_costs_the_frames_of_that_time(system: System, sensor: Sensor) -> None:
    frames, restarts = len(system.frames), system.number(DRIVER, 'clock restarts')
    first = sequences(system)[-1]
    sensor.pull()
    pulled = max(sensor.middle_ns)
    system.wait_for_status(DETECTOR, STALE, 'no frame has come for ')
    with system.subscribed(Header, 'detector/heartbeat') as beats:
        for _ in range(2):
            system.wait_for_status(DRIVER, ERROR, 'does not exist')
    assert not beats
    assert len(system.frames) - frames < 80
    assert system.statuses[DETECTOR][-1].level == STALE
    sensor.plug()
    back = len(system.frames)
    assert system.spin_until(lambda: len(system.frames) > back, RECONNECT_S)
    with system.subscribed(Header, 'detector/heartbeat') as beats:
        system.wait_for_frames(back + 50)
        system.wait(lambda: bool(beats), 'a heartbeat')
    sent = {one for one in sensor.middle_ns if first < one <= pulled}
    in_the_cable = sent - {*sequences(system)}
    assert len(in_the_cable) <= 5  # on a busy machine
    for one in in_the_cable:
        del sensor.middle_ns[one]
    expect_all(system, sensor, first)
    # The clocks went on meanwhile, so the map still holds: the first stamps are right at once.
    assert system.number(DRIVER, 'clock restarts') == restarts
    check_stamps(system, sensor, slice(back, None))
    system.read_all()


def test_a_sensor_that_restarts_costs_no_frame(system: System, sensor: Sensor) -> None:
    restarts, lost = (system.number(DRIVER, key) for key in ('clock restarts', 'lost frames'))
    before = len(system.frames)
    sensor.restart()
    system.wait(lambda: 0 in sequences(system, before), 'the first frame')
    begin = before + sequences(system, before).index(0)
    system.wait_for_frames(begin + 100)
    assert sequences(system, begin) == list(range(len(system.frames) - begin))
    assert system.number(DRIVER, 'clock restarts') == restarts + 1
    assert system.number(DRIVER, 'lost frames') == lost
    stamps = [to_ns(message.header.stamp) for message, _ in system.frames[before:]]
    assert stamps == sorted(set(stamps))
    check_stamps(system, sensor, slice(begin, begin + 100))
    del system.frames[:begin]  # sequences that come again
    system.read_all()


def test_damaged_bytes_cost_their_own_packets_only(system: System, sensor: Sensor) -> None:
    def errors() -> int:
        values = values_of(system.statuses[DRIVER][-1])
        return sum(int(values[f'packets with {kind} errors']) for kind in ('CRC', 'framing'))

    lost = system.number(DRIVER, 'lost frames')
    before = errors()
    sensor.corrupt_share = 0.05
    first = max(sensor.middle_ns) + 1
    system.wait(lambda: len(sensor.damaged) >= 6, 'damage')
    sensor.corrupt_share = 0.0
    last = max(sensor.middle_ns) + 10
    system.wait(lambda: max(sequences(system)) >= last, 'frames')
    expect_all(system, sensor, first)
    assert not set(sequences(system)) & sensor.damaged
    count = len(sensor.damaged)
    system.wait(lambda: errors() - before == count, 'the damage to be counted')
    assert system.number(DRIVER, 'lost frames') - lost >= count
    sensor.corrupt_share = 0.3
    system.read_all()
    sensor.corrupt_share = 0.0
    system.wait_for_status(DRIVER, OK, 'frames a second')


def test_half_of_the_frames_lost_are_counted_and_cost_time(system: System, sensor: Sensor) -> None:
    lost = system.number(DRIVER, 'lost frames')
    first = sequences(system)[-1] + 1
    sensor.lost_share = 0.5
    system.read_all()  # more packets are needed, but all markers are still read
    system.wait(lambda: sequences(system)[-1] > first + 150, 'frames')
    sensor.lost_share = 0.0
    last = max(sensor.middle_ns) + 5
    system.wait(lambda: sequences(system)[-1] > last, 'frames')
    expect_all(system, sensor, first)
    came = [one for one in sequences(system) if one >= first]
    gone = came[-1] - first + 1 - len(came)
    assert gone > 40
    assert system.number(DRIVER, 'lost frames') - lost >= gone


def test_a_subscriber_that_never_reads_costs_no_frames(system: System, sensor: Sensor) -> None:
    first = sequences(system)[-1]
    deaf = Node('deaf', namespace=system.namespace, context=system.node.context)
    try:
        reliable = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        deaf.create_subscription(FrameMsg, 'frames', lambda _: None, reliable)
        name = f'{system.namespace}/frames'
        system.wait(lambda: deaf.count_subscribers(name) > 2, 'the deaf subscriber')
        system.wait_for_frames(len(system.frames) + 95)
        expect_all(system, sensor, first)
    finally:
        deaf.destroy_node()


@pytest.mark.parametrize('node', ['detector', 'driver'])
def test_a_killed_node_costs_its_messages_only(system: System, sensor: Sensor, node: str) -> None:
    first = sequences(system)[-1]
    system.stop(node, signal.SIGKILL)
    killed = len(system.frames)
    if node == 'detector':
        system.wait_for_status(DRIVER, WARN, 'has ended, or hangs', 3.0)
    else:
        system.pass_time(1.0)
    system.start(node, serial_port=system.port)  # which means nothing to the detector
    began = time.monotonic()
    system.wait_for_frames(killed + 100)
    if node == 'detector':
        expect_all(system, sensor, first)
    else:
        assert time.monotonic() - began < 30.0
        expect_all(system, sensor, sequences(system)[-50])
    system.read_all()


def test_a_clock_that_does_not_begin_or_stops_is_an_error_of_both(tmp_path: Path) -> None:
    with running(tmp_path, '/stopped') as system, Sensor(SCENE, system.port):
        clock = system.node.create_publisher(Clock, '/stopped/clock', 10)
        # Markers of their own: the other nodes of this module send transforms, too.
        remapped = ('-r', '/clock:=/stopped/clock', '-p', 'frame_prefix:=stopped/')
        system.start('driver', *remapped, serial_port=system.port, use_sim_time='true')
        system.start('detector', *remapped, use_sim_time='true')
        system.wait_for_status(DRIVER, ERROR, 'nobody publishes /clock')

        def tick() -> None:
            clock.publish(Clock(clock=to_time(time.time_ns())))

        timer = system.node.create_timer(0.01, tick)
        system.wait_for_status(DRIVER, OK, 'frames a second')
        system.wait_for_status(DETECTOR, OK, 'accepted')
        system.node.destroy_timer(timer)
        system.wait_for_status(DRIVER, ERROR, 'the stamps stand still')
        system.wait_for_status(DETECTOR, ERROR, 'the stamps of frames stand still')
        assert not any('hangs' in one.message for one in system.statuses[DRIVER])


def test_a_host_clock_that_is_set_costs_no_frame(tmp_path: Path) -> None:
    """The clock is that of ROS: this test sets it before each frame, and waits for the frame."""
    # In no time: the time at which frames are sent is simulated, too.
    exposed = frames_in_real_time(SCENE, None, 10**18, lambda: 2 * 10**18)
    with (
        running(tmp_path, '/stepped') as system,
        PortLink(system.port) as port,
        in_this_process(
            system,
            *('-r', '/clock:=/stepped/clock', '-p', 'use_sim_time:=true'),
            *('-p', f'serial_port:={system.port}'),
        ) as executor,
    ):
        clock = system.node.create_publisher(Clock, '/stepped/clock', 10)
        came, markers = system.frames, system.markers

        def send(step_s: float, timeout_s: float = PATIENCE_S) -> int | None:
            """Send the next frame; return by how much its stamp is wrong [ns], if it comes."""
            frame, middle_ns = next(exposed)
            middle_ns += round(step_s * 1e9)
            now = Time(nanoseconds=middle_ns + DELAY_NS, clock_type=ClockType.ROS_TIME)
            while any(node.get_clock().now() != now for node in executor.get_nodes()):
                clock.publish(Clock(clock=now.to_msg()))
                executor.spin_once(timeout_sec=0.1)
            port.write(encode_frame(frame))
            seen = len(came)
            if not system.spin_until(lambda: len(came) > seen, timeout_s):
                return None
            assert came[-1][0].sequence == frame.sequence
            return to_ns(came[-1][0].header.stamp) - middle_ns

        while send(0.0, 0.1) is None:  # until the port is open
            pass
        for step_s in (0.0, -5.0, 8.0):
            markers.clear()
            errors_ns = [send(step_s) for _ in range(250)]
            assert None not in errors_ns
            system.wait(lambda: {one.id for one, _ in markers} >= COFFEE_IDS, 'all markers')
            # A step forward is known from a transport that stalls after a second only.
            assert all(one is not None and abs(one) < 1e6 for one in errors_ns[100:])
