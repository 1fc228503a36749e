# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was seen live, what a bag of it says offline, and what a replay of the bag says."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')
pytest.importorskip('rosbags', reason='needs rosbags, which is a pip extra')

from diagnostic_msgs.msg import DiagnosticArray
from harness import PATIENCE_S, Sensor, wait_for_nodes
from rosgraph_msgs.msg import Clock

from retrolidar_ros.bag import FrameWriter, read_frames
from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import from_frame_msg, to_frame_msg, to_ns, to_time
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Frame

FRAME_ID = 'retrolidar_optical_frame'
LIVE_FRAMES = 600
EARLIER_NS = 10_000_000_000  # what the clock says in the replay, before the bag begins


class Counter:
    """Knows how many frames the detector of a namespace has taken."""

    def __init__(self, listener: Listener, namespace: str) -> None:
        self.frames = 0
        self._name = f'{namespace}/detector: markers'
        listener.node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, 10)

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == self._name:
                values = {value.key: value.value for value in status.values}
                self.frames = int(values['frames'])


def watch(path: Path, namespace: str) -> Listener | None:
    """Return what was heard of an emulated sensor until it was unplugged.

    None if the detector has missed a frame: it takes them by best effort, and the first may come
    before both ends of a connection know of each other.
    """
    listener = Listener(namespace)
    counter = Counter(listener, namespace)
    port = path / 'port'
    with ProcessGroup(path) as processes:
        command = ['--ros-args', '-r', f'__ns:={namespace}', '-p', f'serial_port:={port}']
        for node in ('driver', 'detector'):
            processes.start(node, [executable(node), *command])
        wait_for_nodes(listener)
        with Sensor(load_scene('coffee'), port):
            assert listener.spin_until(lambda: len(listener.frames) >= LIVE_FRAMES, PATIENCE_S)
        complete = listener.spin_until(lambda: counter.frames >= len(listener.frames), 5.0)
    listener.close()
    return listener if complete and counter.frames == len(listener.frames) else None


@pytest.fixture(scope='module')
def live(tmp_path_factory: pytest.TempPathFactory) -> Listener:
    for attempt in range(3):
        if (listener := watch(tmp_path_factory.mktemp('live'), f'/live_{attempt}')) is not None:
            return listener
    raise AssertionError('the detector missed a frame three times')


@pytest.fixture(scope='module')
def bag(live: Listener, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('replay') / 'bag'
    with FrameWriter(path) as writer:
        for message, _ in live.frames:
            writer.write(from_frame_msg(message))
    return path


@pytest.fixture(scope='module')
def replayed(bag: Path, tmp_path_factory: pytest.TempPathFactory) -> list[MarkerDetection]:
    """Play the bag to a new detector, faster than it was, on the clock of the bag."""
    frames = list(read_frames(bag))
    listener = Listener('/replay')
    counter = Counter(listener, '/replay')
    clock = listener.node.create_publisher(Clock, '/replay/clock', 10)
    publisher = listener.node.create_publisher(FrameMsg, 'frames', 10)
    command = [executable('detector'), '--ros-args', '-r', '__ns:=/replay']
    command += ['-r', '/clock:=/replay/clock', '-p', 'use_sim_time:=true']
    with ProcessGroup(tmp_path_factory.mktemp('replayed')) as processes:
        processes.start('detector', command)
        assert listener.spin_until(
            lambda: publisher.get_subscription_count() > 0 and clock.get_subscription_count() > 0,
            PATIENCE_S,
        )

        def play(frame: Frame) -> None:
            clock.publish(Clock(clock=to_time(frame.stamp_ns + EARLIER_NS)))
            publisher.publish(to_frame_msg(frame, FRAME_ID))

        # The first may come before the detector listens; the same frame again changes nothing.
        for _ in range(5):
            play(frames[0])
            if listener.spin_until(lambda: counter.frames > 0, 2.5):
                break
        first = counter.frames
        for frame in frames[1:]:
            play(frame)
            listener.spin_until(lambda: False, 0.008)
        wanted = first + len(frames) - 1
        assert listener.spin_until(lambda: counter.frames >= wanted, PATIENCE_S), counter.frames
    messages = [message for message, _ in listener.markers]
    listener.close()
    return messages


def described(message: MarkerDetection) -> dict[str, Any]:
    """Return a message as `retrolidar decode --json` has it."""
    position = message.pose.pose.position
    return {
        'stamp': to_ns(message.header.stamp) * 1e-9,
        'id': message.id,
        'x': position.x,
        'y': position.y,
        'z': position.z,
        'range': message.range,
        'range_stddev': message.range_stddev,
        'snr': message.snr,
        'evidence': message.evidence,
        'decision_margin': message.decision_margin,
        'score': message.score,
        'bit_period': message.bit_period,
        'corrected_bits': message.corrected_bits,
        'packets': message.packets,
        'zones': list(message.zones),
        'start': to_ns(message.start) * 1e-9,
        'end': to_ns(message.end) * 1e-9,
    }


def test_a_replay_says_what_was_said_live(live: Listener, replayed: list[MarkerDetection]) -> None:
    assert len(replayed) > 15
    assert replayed == [message for message, _ in live.markers]


def test_decoding_the_bag_says_what_was_said_live(live: Listener, bag: Path) -> None:
    command = [sys.executable, '-m', 'retrolidar_ros.cli.main', 'decode', str(bag), '--json']
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    offline = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(offline) == len(live.markers)
    for one, (message, _) in zip(offline, live.markers, strict=True):
        said = described(message)
        assert list(one) == list(said)
        for key, value in said.items():
            # A message holds numbers of 32 bits.
            assert one[key] == (pytest.approx(value, rel=1e-6) if value != 0 else 0), key


def test_the_last_frames_used_are_among_those_sent(
    live: Listener, replayed: list[MarkerDetection]
) -> None:
    frames = {to_ns(message.header.stamp) for message, _ in live.frames}
    assert {to_ns(message.end) for message in replayed} <= frames
