# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""An emulated sensor sends its frames in real time, and records them."""

import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from threading import Event

import numpy as np
import pytest
from harness_frames import sequences
from harness_serial import listen

from retrolidar_ros.bag import read_frames as read_bag
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Noise, Sensor, Surface
from retrolidar_ros.scene.emulator import emulate, frames_in_real_time, record
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.wire import FrameReader

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

    def __init__(self) -> None:
        self.now_ns = 5_000_000_000
        self.late_ns = 0

    def __call__(self) -> int:
        return self.now_ns

    def sleep(self, seconds: float) -> None:
        assert seconds > 0
        self.now_ns += round(seconds * 1e9) + self.late_ns


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


def test_all_frames_arrive_in_order_and_at_their_time(link: Path) -> None:
    linked, listening = Event(), Event()

    def ready() -> None:
        linked.set()
        assert listening.wait(10)

    reader = FrameReader()
    frames: list[Frame] = []
    arrivals_s: list[float] = []
    with ThreadPoolExecutor(1) as pool:
        future = pool.submit(emulate, SCENE, link, 0.6, ready)
        assert linked.wait(10)
        with listen(link) as line:
            start_s = time.monotonic()
            listening.set()
            while len(frames) < 120:
                data = line.read(max(1, line.in_waiting))
                assert data
                new = reader.feed(data)
                frames += new
                arrivals_s += [time.monotonic() - start_s] * len(new)
            assert future.result(10) == (120, 0)
    assert sequences(frames) == list(range(120))
    assert reader.counts.damaged == 0
    ends_s = 0.005 * (np.arange(120) + 1)
    lag_s = np.array(arrivals_s) - ends_s
    assert lag_s.min() > -1e-4  # no sensor sends what it has not seen
    assert np.median(lag_s) < 0.05
    truth = Simulation(SCENE)
    simulated = [frame for count in (50, 50, 20) for frame in truth.advance(count)]
    for frame, true in zip(frames, simulated, strict=True):
        assert frame.sensor_time_us == true.sensor_time_us
        assert frame.signal == pytest.approx(true.signal, abs=1 / 4096 + 1e-5)
        np.testing.assert_array_equal(frame.status, true.status)
    assert not link.exists()


@pytest.mark.parametrize('request_to_end', [signal.SIGINT, signal.SIGTERM])
def test_ending_unplugs_the_sensor(
    tmp_path: Path, link: Path, request_to_end: signal.Signals
) -> None:
    scene = tmp_path / 'wall.yaml'
    scene.write_text('surfaces: [{distance: 1 m, signal: 9 kcps/SPAD}]\n')
    command = [sys.executable, '-m', 'retrolidar_ros.cli', 'emulate', str(scene)]
    command += ['--port-link', str(link)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert 'a sensor is at' in process.stdout.readline()
        reader, frames = FrameReader(), list[Frame]()
        with listen(link) as line:
            while len(frames) < 3:
                data = line.read(max(1, line.in_waiting))
                assert data
                frames += reader.feed(data)
        process.send_signal(request_to_end)
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
