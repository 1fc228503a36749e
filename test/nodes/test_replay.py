# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was read live, what a bag of it gives offline, and what a replay of the bag gives."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')
pytest.importorskip('rosbags', reason='needs rosbags, which is a pip extra')

from harness import Sensor, wait_for_nodes
from harness_nodes import FRAME_ID, System, running, values_of
from rosgraph_msgs.msg import Clock

from retrolidar_ros.bag import FrameWriter, read_frames
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import from_frame_msg, to_frame_msg, to_ns, to_time
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Frame

LIVE_FRAMES = 600
EARLIER_NS = 10_000_000_000  # what the clock reads in the replay, before the bag begins


def taken(system: System) -> int:
    """Return how many frames the detector has taken, as it last reported."""
    statuses = system.statuses['detector: markers']
    return int(values_of(statuses[-1])['frames']) if statuses else 0


def watch(path: Path, namespace: str) -> Listener | None:
    """Return what an emulated sensor made the nodes publish until it was unplugged.

    None if the detector has missed a frame: it takes them by best effort, and the first may come
    before both ends of a connection know of each other.
    """
    with running(path, namespace) as system:
        listener = system.listener
        for node in ('driver', 'detector'):
            system.start(node, serial_port=system.port)
        wait_for_nodes(listener)
        with Sensor(load_scene('coffee'), system.port):
            system.wait(lambda: len(listener.frames) >= LIVE_FRAMES, 'frames')
        complete = listener.spin_until(lambda: taken(system) >= len(listener.frames), 5.0)
        return listener if complete and taken(system) == len(listener.frames) else None


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


def test_a_replay_reads_what_was_read_live(live: Listener, bag: Path, tmp_path: Path) -> None:
    """The bag is played to a new detector, faster than it was, on the clock of the bag."""
    frames = list(read_frames(bag))
    with running(tmp_path, '/replay') as system:
        clock = system.node.create_publisher(Clock, '/replay/clock', 10)
        publisher = system.node.create_publisher(FrameMsg, 'frames', 10)
        system.start('detector', '-r', '/clock:=/replay/clock', use_sim_time='true')
        system.wait(
            lambda: publisher.get_subscription_count() > 0 and clock.get_subscription_count() > 0,
            'the detector',
        )

        def play(frame: Frame) -> None:
            clock.publish(Clock(clock=to_time(frame.stamp_ns + EARLIER_NS)))
            publisher.publish(to_frame_msg(frame, FRAME_ID))

        # The first may come before the detector listens; the same frame again changes nothing.
        for _ in range(5):
            play(frames[0])
            if system.listener.spin_until(lambda: taken(system) > 0, 2.5):
                break
        wanted = taken(system) + len(frames) - 1
        for frame in frames[1:]:
            play(frame)
            system.pass_time(0.008)
        system.wait(lambda: taken(system) >= wanted, 'all frames to be taken')
        replayed = [message for message, _ in system.listener.markers]
    assert len(replayed) > 15
    assert replayed == [message for message, _ in live.markers]
    sent = {to_ns(message.header.stamp) for message, _ in live.frames}
    assert {to_ns(message.end) for message in replayed} <= sent


def described(message: MarkerDetection) -> dict[str, Any]:
    """Return a message as `retrolidar decode --json` has it."""
    position = message.pose.pose.position
    return {
        'stamp': to_ns(message.header.stamp) * 1e-9,
        'id': message.id,
        **{axis: getattr(position, axis) for axis in 'xyz'},
        **{name: getattr(message, name) for name in ('range', 'range_stddev', 'snr', 'evidence')},
        **{name: getattr(message, name) for name in ('decision_margin', 'score', 'bit_period')},
        **{name: getattr(message, name) for name in ('corrected_bits', 'packets')},
        'zones': list(message.zones),
        'start': to_ns(message.start) * 1e-9,
        'end': to_ns(message.end) * 1e-9,
    }


def test_decoding_the_bag_reads_what_was_read_live(live: Listener, bag: Path) -> None:
    command = [sys.executable, '-m', 'retrolidar_ros.cli.main', 'decode', str(bag), '--json']
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    offline = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(offline) == len(live.markers)
    for one, (message, _) in zip(offline, live.markers, strict=True):
        expected = described(message)
        assert list(one) == list(expected)
        for key, value in expected.items():
            # A message holds numbers of 32 bits.
            assert one[key] == (pytest.approx(value, rel=1e-6) if value != 0 else 0), key
