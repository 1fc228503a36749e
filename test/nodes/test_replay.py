# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was read live, what a bag of it gives offline, and what a replay of the bag gives."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip('rosbags', reason='needs rosbags, which is a pip extra')

from diagnostic_msgs.msg import DiagnosticStatus
from harness import Sensor, wait_for_nodes
from harness_observer import FRAME_ID, System, running, values_of
from rclpy.qos import QoSProfile
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header

from retrolidar_ros.bag import FrameWriter, read_frames
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import from_frame_msg, to_frame_msg, to_ns, to_time
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.qos import FRAME_QOS
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.sensor.frame import Frame

DETECTOR = 'detector: markers'
LIVE_FRAMES = 400
STALL_S = 7.0
EARLIER_NS = 10_000_000_000  # what the clock reads in the replay, before the bag begins


@pytest.fixture(scope='module')
def live(tmp_path_factory: pytest.TempPathFactory) -> Listener:
    """Return what an emulated sensor made the nodes publish until it was unplugged."""
    with running(tmp_path_factory.mktemp('live'), '/live') as system:
        system.start('driver', serial_port=system.port)
        with Sensor(load_scene('coffee'), system.port):
            system.wait(lambda: bool(system.frames), 'a frame, so that from now on all are heard')
        system.start('detector')
        wait_for_nodes(system)
        system.frames.clear()
        with Sensor(load_scene('coffee'), system.port):
            system.wait(lambda: len(system.frames) >= LIVE_FRAMES, 'frames')
        status = system.wait_for_status(DETECTOR, DiagnosticStatus.STALE, 'no frame has come')
        values = values_of(status)
        assert values['lost frames'] == '0'
        # The first frames may come before both ends of a connection know of each other.
        missed = len(system.frames) - int(values['frames'])
        assert 0 <= missed < LIVE_FRAMES / 2
        del system.frames[:missed]
    return system


@pytest.fixture(scope='module')
def bag(live: Listener, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp('replay') / 'bag'
    with FrameWriter(path) as writer:
        for message, _ in live.frames:
            writer.write(from_frame_msg(message))
    return path


@contextmanager
def replayed(
    system: System, first: Frame, *given: str, qos: QoSProfile | int = 10
) -> Iterator[Callable[[Frame], None]]:
    """Start a detector on the clock of a bag; yield what plays a frame, as `ros2 bag play` does."""
    clock = system.node.create_publisher(Clock, f'{system.namespace}/clock', 10)
    publisher = system.node.create_publisher(FrameMsg, 'frames', qos)
    remapped = ('-r', f'/clock:={system.namespace}/clock')
    system.start('detector', *remapped, *given, use_sim_time='true')

    def play(frame: Frame) -> None:
        clock.publish(Clock(clock=to_time(frame.stamp_ns + EARLIER_NS)))
        publisher.publish(to_frame_msg(frame, FRAME_ID))

    with system.subscribed(Header, 'detector/heartbeat') as beats:
        # Until the detector listens; the same frame again changes nothing.
        while not system.spin_until(lambda: bool(beats), 0.1):
            play(first)
    yield play


def test_a_replay_reads_what_was_read_live(live: Listener, bag: Path, tmp_path: Path) -> None:
    """By a detector that stands still, and is then given the frames of seven seconds at once."""
    first, *frames = list(read_frames(bag))
    with running(tmp_path, '/replay') as system, replayed(system, first, qos=FRAME_QOS) as play:
        began_s, pid = time.monotonic(), system.processes.pid('detector')
        os.kill(pid, signal.SIGSTOP)
        for frame in frames:
            due_s = began_s + (frame.stamp_ns - first.stamp_ns) * 1e-9
            system.pass_time(max(due_s - time.monotonic(), 0.0))
            play(frame)
            if time.monotonic() > began_s + STALL_S:
                os.kill(pid, signal.SIGCONT)
        # A bag may end before the stall does, if its first frames were not heard.
        os.kill(pid, signal.SIGCONT)
        # DDS may ask for what is missing only every three seconds.
        system.wait(lambda: system.number(DETECTOR, 'frames') > len(frames), 'all frames')
        assert system.number(DETECTOR, 'lost frames') == 0
        replay = [message for message, _ in system.markers]
    assert len(replay) > 10
    assert replay == [message for message, _ in live.markers]
    sent = {to_ns(message.header.stamp) for message, _ in live.frames}
    assert {to_ns(message.end) for message in replay} <= sent


def is_stopped(pid: int) -> bool:
    """Return whether all threads of a process have been stopped."""
    stats = Path(f'/proc/{pid}/task').glob('*/stat')
    return all(stat.read_text().rpartition(') ')[2].startswith('T') for stat in stats)


def test_a_detector_that_cannot_follow_says_how_many_it_lost(bag: Path, tmp_path: Path) -> None:
    first, *frames = list(read_frames(bag))
    shallow = ('-p', 'qos_overrides./overrun/frames.subscription.depth:=10')
    with running(tmp_path, '/overrun') as system, replayed(system, first, *shallow) as play:
        # In the second of these looks no frame repeats the first one any longer.
        system.next_status(DETECTOR)
        heard = int(values_of(system.next_status(DETECTOR))['frames'])
        pid = system.processes.pid('detector')
        os.kill(pid, signal.SIGSTOP)
        system.wait(lambda: is_stopped(pid), 'the detector to stop')
        for frame in frames[:100]:
            play(frame)
        os.kill(pid, signal.SIGCONT)
        system.wait_for_status(DETECTOR, DiagnosticStatus.WARN, 'frames were lost between')

        def known() -> int:
            values = values_of(system.statuses[DETECTOR][-1])
            return int(values['frames']) - heard + int(values['lost frames'])

        system.wait(lambda: known() == 100, 'all frames, or that they were lost')
        lost = values_of(system.statuses[DETECTOR][-1])['lost frames']
        assert int(lost) > 50
        assert 'frames were lost between driver and detector' in system.log('detector')
        for frame in frames[110:120]:  # those between are missing in the bag
            play(frame)
        status = system.wait_for_status(DETECTOR, DiagnosticStatus.WARN, '10 frames were not sent')
        assert values_of(status)['lost frames'] == lost


def described(message: MarkerDetection) -> dict[str, Any]:
    """Return a message as `retrolidar decode --json` has it."""
    same = (
        'id range range_stddev snr evidence decision_margin score bit_period corrected_bits packets'
    )
    times = {'stamp': message.header.stamp, 'start': message.start, 'end': message.end}
    return {
        **{name: getattr(message, name) for name in [*same.split(), 'packets']},
        **{name: to_ns(time) * 1e-9 for name, time in times.items()},
        **{axis: getattr(message.pose.pose.position, axis) for axis in 'xyz'},
        'zones': list(message.zones),
    }


def test_decoding_the_bag_reads_what_was_read_live(live: Listener, bag: Path) -> None:
    command = [sys.executable, '-m', 'retrolidar_ros.cli', 'decode', str(bag), '--json']
    result = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    offline = [json.loads(line) for line in result.stdout.splitlines()]
    assert len(offline) == len(live.markers)
    for one, (message, _) in zip(offline, live.markers, strict=True):
        expected = described(message)
        assert one.keys() == expected.keys()
        for key, value in expected.items():
            # A message holds numbers of 32 bits.
            assert one[key] == (pytest.approx(value, rel=1e-6) if value != 0 else 0), key


def test_the_command_replays_at_times_of_the_bag(live: Listener, bag: Path, tmp_path: Path) -> None:
    """To a detector with the defaults, three times as fast, and again from the beginning."""
    frames = [message for message, _ in live.frames]
    with running(tmp_path, '/command') as system:

        def ids() -> set[int]:
            return {message.id for message, _ in system.markers}

        system.start('detector')
        system.wait(lambda: system.node.count_subscribers('frames') == 2, 'the detector')
        command = [sys.executable, '-m', 'retrolidar_ros.cli', 'replay', str(bag)]
        options = ['--rate', '3', '--loop', '--frame-id', FRAME_ID]
        # The bag has its own topic; the nodes have another.
        topic = ['--topic', '/retrolidar/frames', '--to', '/command/frames']
        command += [*options, *topic]
        with subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=tmp_path) as process:
            system.wait(lambda: len(system.frames) >= 2 * len(frames), 'the second round')
            # Under load the detector is heard of late, or is late; then it reads the next round.
            system.wait(lambda: ids() == {2073, 2096, 2107}, 'the markers')
            process.send_signal(signal.SIGINT)
            assert process.wait(20) == 0
        # The first frames may come before both ends of a connection know of each other, or late.
        heard = [message for message, _ in system.frames]
        missed = frames.index(heard[0])
        again = len(frames) - missed
        assert heard[:again] == frames[missed:]
        assert heard[again : again + len(frames)] == frames
        took_s = (system.frames[again + len(frames) - 1][1] - system.frames[again][1]) * 1e-9
        stamps_ns = [to_ns(one.header.stamp) for one in frames]
        recorded_s = (stamps_ns[-1] - stamps_ns[0]) * 1e-9
        # A loaded machine is late, but never as late as the bag's own time.
        assert recorded_s / 4 < took_s < recorded_s / 1.5
        assert ids() == {2073, 2096, 2107}
