# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An emulated sensor: its terminal, its frames in real time, and their records."""

import itertools
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest
import serial
from harness_frames import make_packets, sequences
from st_board import listen

from retrolidar_ros.bag import read_frames as read_bag
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Sensor, Surface
from retrolidar_ros.scene.emulator import PortLink, emulate, frames_in_real_time, record
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.wire import FrameReader, encode_frame

SCENE = Scene(
    seed=2,
    sensor=Sensor(period_s=0.005, noise=Noise(4.6, 0.22)),
    markers=(Marker(id=77, position_m=(0.1, 0.1, 1), name='m'),),
    surfaces=(Surface(2, 40),),
    ambient=3,
)
WALL = Scene(sensor=Sensor(period_s=0.001), surfaces=(Surface(2, 40),))


class Clock:
    """A clock that time.sleep moves on."""

    now_ns = 5_000_000_000

    def __call__(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now_ns += round(seconds * 1e9)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(time, 'sleep', clock.sleep)
    return clock


def test_each_frame_comes_when_its_exposure_ends(clock: Clock) -> None:
    sensor = Sensor(period_error=-0.0036, clock_error=0.01, jitter_s=1e-3)
    scene = replace(SCENE, sensor=sensor)
    period_ns = round(0.021e9 * 0.9964)
    count = 0
    for frame, middle_ns in frames_in_real_time(scene, 3.0, clock(), clock):
        assert middle_ns - 5e9 == pytest.approx(frame.sensor_time_us * 1000 / 1.01, abs=2)
        assert middle_ns - 5e9 == pytest.approx((frame.sequence + 0.5) * period_ns, abs=2.1e6)
        assert clock() == pytest.approx(middle_ns + period_ns / 2, abs=1000)
        count += 1
    assert count == 143


def test_a_late_emulator_catches_up_and_need_not_end(clock: Clock) -> None:
    frames = frames_in_real_time(WALL, None, clock(), clock)
    assert next(frames)[0].sequence == 0
    clock.now_ns += 300_000_000
    assert [next(frames)[0].sequence for _ in range(300)] == list(range(1, 301))
    for number in range(301, 3000):
        frame, middle_ns = next(frames)
        assert frame.sequence == number
        assert clock() == pytest.approx(middle_ns + 500_000, abs=1000)


def hear(line: serial.Serial, reader: FrameReader, count: int) -> Iterator[Frame]:
    """Yield so many frames as they arrive."""
    while reader.counts.frames < count:
        data = line.read(max(1, line.in_waiting))
        assert data
        yield from reader.feed(data)


def test_all_frames_arrive_in_order_and_at_their_time(link: Path) -> None:
    linked, listening = Event(), Event()

    def ready() -> None:
        linked.set()
        assert listening.wait(10)

    reader = FrameReader()
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(emulate, SCENE, link, 0.6, ready)
        assert linked.wait(10)
        with listen(link) as line:
            start_s = time.monotonic()
            listening.set()
            arrivals = [(frame, time.monotonic() - start_s) for frame in hear(line, reader, 120)]
            assert future.result(10) == (120, 0)
    frames, arrivals_s = zip(*arrivals, strict=True)
    assert sequences(frames) == list(range(120))
    assert reader.counts.damaged == 0
    lag_s = np.array(arrivals_s) - 0.005 * (np.arange(120) + 1)
    assert lag_s.min() > -1e-4  # no sensor sends what it has not seen
    assert np.median(lag_s) < 0.05
    for frame, true in zip(frames, Simulation(SCENE).advance(120), strict=True):
        assert frame.sensor_time_us == true.sensor_time_us
        assert frame.signal == pytest.approx(true.signal, abs=1 / 4096 + 1e-5)
        np.testing.assert_array_equal(frame.status, true.status)
    assert not link.exists()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_ending_unplugs_the_sensor(tmp_path: Path, link: Path, number: signal.Signals) -> None:
    scene = tmp_path / 'wall.yaml'
    scene.write_text('surfaces: [{distance: 1 m, signal: 9 kcps/SPAD}]\n')
    command = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate', str(scene)]
    command += ['--port-link', str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert 'a sensor is at' in process.stdout.readline()
        with listen(link) as line:
            assert len(list(hear(line, FrameReader(), 3))) >= 3
        process.send_signal(number)
        assert ' frames sent, ' in process.stdout.read()
        assert process.wait(10) == 0
    assert not link.is_symlink()


def test_record_writes_every_frame_with_host_time(tmp_path: Path) -> None:
    before_ns = time.time_ns()
    pytest.importorskip('rosbags', reason='bags are written with rosbags')
    assert record(SCENE, tmp_path / 'bag', 'sqlite3', 10.0) == 2000
    after_ns = time.time_ns()
    assert (tmp_path / 'bag' / 'bag.db3').is_file()
    frames = list(read_bag(tmp_path / 'bag'))
    assert sequences(frames) == list(range(2000))
    start_ns = frames[0].stamp_ns - 2_500_000
    assert before_ns <= start_ns <= after_ns
    stamps = np.array([frame.stamp_ns for frame in frames])
    assert stamps - start_ns == pytest.approx(5e6 * (np.arange(2000) + 0.5), abs=1000)


@contextmanager
def raw_reader(port: Path) -> Iterator[int]:
    """Open the port without emptying its buffers, as not every program does."""
    descriptor = os.open(port, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    yield descriptor
    os.close(descriptor)


def read_raw(descriptor: int, reader: FrameReader, count: int) -> list[Frame]:
    """Read until `count` frames have come, or nothing comes for a second."""
    frames: list[Frame] = []
    while len(frames) < count and select.select([descriptor], [], [], 1)[0]:
        frames += reader.feed(os.read(descriptor, 65536))
    return frames


def test_the_link_is_there_as_long_as_the_port(link: Path) -> None:
    with suppress(KeyboardInterrupt), PortLink(link):
        assert link.is_symlink()
        assert link.is_char_device()
        line = listen(link)
        raise KeyboardInterrupt  # even when the work fails
    assert not link.is_symlink()
    with pytest.raises(serial.SerialException), line:
        line.read(1)
    link.symlink_to('/dev/pts/9999')  # as a killed emulator leaves it
    with PortLink(link) as port, listen(link):
        assert port.write(b'x')
        link.unlink()
    assert not link.exists()
    before = len(os.listdir('/dev/fd'))
    with pytest.raises(FileNotFoundError):
        PortLink(link / 'port')
    assert len(os.listdir('/dev/fd')) == before


@pytest.mark.parametrize('kind', ['/dev/null', 'nowhere', 'file', 'directory', 'port'])
def test_what_is_there_already_is_refused_and_kept(link: Path, tmp_path: Path, kind: str) -> None:
    with PortLink(tmp_path / 'live') as live:
        if kind == 'file':
            link.write_text('precious')
        elif kind == 'directory':
            link.mkdir()
        else:
            link.symlink_to(os.readlink(tmp_path / 'live') if kind == 'port' else kind)
        before = os.readlink(link) if link.is_symlink() else link.stat()
        for make in (PortLink, lambda path: emulate(Scene(), path, 1.0)):
            with pytest.raises(FileExistsError, match='port exists; give a path'):
                make(link)
        assert before == (os.readlink(link) if link.is_symlink() else link.stat())
        with listen(tmp_path / 'live') as line:
            assert live.write(b'abc')
            assert line.read(3) == b'abc'


def test_what_a_listener_left_unread_is_not_for_the_next(link: Path) -> None:
    reader = FrameReader()
    with PortLink(link) as port:
        with raw_reader(link):
            while port.write(make_packets(1)[0]):
                pass
        assert not port.write(b'nobody hears this')
        with raw_reader(link) as second:
            assert port.write(make_packets(8)[7])
            assert sequences(read_raw(second, reader, 1)) == [7]
            assert reader.counts.damaged == 0
            # Nor does a packet that was cut off, longer than any terminal takes, cost the next.
            assert not port.write(b'x' * 100_000)
            while select.select([second], [], [], 0.1)[0]:
                assert reader.feed(os.read(second, 65536)) == []
            assert port.write(make_packets(1)[0])
            assert sequences(read_raw(second, reader, 1)) == [0]
            assert reader.counts.damaged == 1


def test_a_listener_that_is_slow_gets_some_packets_and_never_a_wrong_one(link: Path) -> None:
    sent, reader = make_packets(1400), FrameReader()
    frames: list[Frame] = []
    taken: list[bool] = []
    with PortLink(link) as port, raw_reader(link) as descriptor:
        for packet in sent:
            taken.append(port.write(packet))
            # At first it does not read at all.
            if len(taken) > 400 and select.select([descriptor], [], [], 0)[0]:
                frames += reader.feed(os.read(descriptor, 77))
        frames += read_raw(descriptor, reader, sum(taken) - len(frames))
    full = taken.index(False)
    assert full > 20  # some hundred milliseconds are buffered
    assert sum(taken[full:400]) < 20  # the terminal may still move what it holds
    numbers = sequences(frames)
    assert full + 20 < len(numbers) == sum(taken) < 1400
    assert numbers == sorted(set(numbers))
    torn = sum(before and not now for before, now in itertools.pairwise([True, *taken]))
    assert reader.counts.damaged <= torn
    for frame in frames:
        assert encode_frame(frame) == sent[frame.sequence]
