# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What driver and detector publish and report, in a process each."""

import os
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from harness import Sensor, check_detections, check_frames
from harness_nodes import FRAME_ID, System, running
from harness_observer import values_of
from lifecycle_msgs.msg import Transition
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_frame_msg, to_ns, to_time
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene

DRIVER, DETECTOR = 'driver: frames', 'detector: markers'
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
STALE = DiagnosticStatus.STALE
SCENE = load_scene('coffee')

Pair = tuple[System, Sensor]


@pytest.fixture(scope='module')
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Pair]:
    """Start the nodes, and then plug in a sensor."""
    with running(tmp_path_factory.mktemp('health'), '/health') as system:
        system.start('driver', serial_port=system.port, autostart='true')
        system.start('detector')
        system.wait(lambda: {DRIVER, DETECTOR} <= set(system.statuses), 'both nodes')
        with Sensor(SCENE, system.port) as sensor:
            yield system, sensor


def test_markers_are_read_and_placed(pair: Pair) -> None:
    system, sensor = pair
    first = system.statuses[DRIVER][0]
    assert (first.level, 'port does not exist' in first.message) == (ERROR, True)
    first = system.statuses[DETECTOR][0]
    assert (first.level, first.message) == (WARN, 'no frame has come yet')
    system.read_all()
    check_frames(system, sensor, FRAME_ID)
    check_detections(system, SCENE, FRAME_ID)
    system.wait_for_status(DRIVER, OK, 'frames a second')
    values = values_of(system.wait_for_status(DETECTOR, OK, 'packets accepted'))
    assert values['method'] == 'joint'
    assert int(values['frames']) > 20
    assert 3 <= int(values['accepted']) <= int(values['candidates'])
    # What is left over of packets that are subtracted may stand out a little.
    rejected = {key for key in values if key.startswith('rejected: ')}
    assert rejected <= {'rejected: evidence'}, values


def test_transforms_go_out_before_what_they_belong_to(pair: Pair) -> None:
    """By the times at which they were sent: on the way, one topic may still overtake another."""
    system, _ = pair
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


def test_a_heartbeat_is_of_the_last_frame_that_was_judged(pair: Pair) -> None:
    system, sensor = pair
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
        sensor.pull()
        system.wait_for_status(DETECTOR, STALE, 'no frame has come for ')
        silent = len(beats)
        system.wait_for_status(DETECTOR, STALE, 'no frame has come for ')
        assert len(beats) == silent
        sensor.plug()
        system.wait(lambda: len(beats) > silent, 'a heartbeat')


def test_frames_that_a_driver_does_not_send_are_not_lost(pair: Pair) -> None:
    system, _ = pair
    change_state = system.services.change_state
    assert not change_state('driver', Transition.TRANSITION_CONFIGURE)  # and it lives on
    lost, seen = system.number(DETECTOR, 'lost frames'), len(system.statuses[DETECTOR])
    assert change_state('driver', Transition.TRANSITION_DEACTIVATE)
    system.pass_time(1.5)
    assert change_state('driver', Transition.TRANSITION_ACTIVATE)
    system.wait_for_status(DETECTOR, WARN, 'frames were not sent')
    system.wait_for_status(DETECTOR, OK, 'accepted')
    assert not any('were lost' in status.message for status in system.statuses[DETECTOR][seen:])
    assert system.number(DETECTOR, 'lost frames') == lost


def test_a_detector_that_stands_still_is_reported_and_loses_nothing(pair: Pair) -> None:
    system, _ = pair
    pid = system.processes.pid('detector')
    lost, seen = system.number(DETECTOR, 'lost frames'), len(system.statuses[DETECTOR])
    os.kill(pid, signal.SIGSTOP)
    try:
        system.wait_for_status(DRIVER, WARN, 'the detector has judged no frame for', 2.5)
        system.pass_time(1.5)
        assert len(system.statuses[DETECTOR]) <= seen + 1  # nobody speaks in its name
    finally:
        os.kill(pid, signal.SIGCONT)
    system.wait_for_status(DETECTOR, OK, 'accepted')
    assert system.number(DETECTOR, 'lost frames') == lost
    system.wait_for_status(DRIVER, OK, 'frames a second')


def test_two_senders_of_one_frame_id_are_an_error_that_names_them(pair: Pair) -> None:
    system, _ = pair
    publisher = system.node.create_publisher(FrameMsg, 'frames', 10)
    frames = iter(Simulation(SCENE).run(60.0))

    def send() -> None:
        frame = replace(next(frames), stamp_ns=system.node.get_clock().now().nanoseconds)
        publisher.publish(to_frame_msg(frame, FRAME_ID))

    timer = system.node.create_timer(0.021, send)
    try:
        status = system.wait_for_status(DETECTOR, ERROR, 'come mixed by')
        assert '/health/driver, /health/listener' in status.message
    finally:
        system.node.destroy_timer(timer)
        system.node.destroy_publisher(publisher)
    system.wait_for_status(DETECTOR, OK, 'accepted')


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
