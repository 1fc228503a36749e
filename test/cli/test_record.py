# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor at a port, recorded by the executable."""

import re
import signal
import subprocess
import sys
from pathlib import Path
from typing import IO

import numpy as np
import pytest
from harness import Sensor

pytest.importorskip('rosbags', reason='bags are written with rosbags')

from retrolidar_ros.bag import read_frames
from retrolidar_ros.cli.main import main
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.scene.emulator import PortLink, frames_in_real_time


def until(stream: IO[str] | None, pattern: str) -> str:
    """Return the first line that matches; a stream that ends before fails."""
    assert stream is not None
    seen = []
    for line in stream:
        if re.search(pattern, line):
            return line
        seen.append(line)
    raise AssertionError(f'no {pattern} in {seen}')


@pytest.mark.parametrize(('storage', 'end'), [('sqlite3', signal.SIGINT), ('mcap', signal.SIGTERM)])
def test_a_recording_holds_what_was_sent_before_and_after_a_cable_was_out(
    tmp_path: Path, storage: str, end: signal.Signals
) -> None:
    command = [sys.executable, '-m', 'retrolidar_ros.cli', 'record', 'port', '-o', 'bag']
    command += ['--storage', storage]
    with Sensor(load_scene('coffee'), tmp_path / 'port') as sensor:
        pipe = subprocess.PIPE
        process = subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, cwd=tmp_path)
        line = until(process.stderr, 'zone 9 blinks by')
        sensor.pull()
        until(process.stderr, 'was lost; is the sensor still plugged in')
        sensor.plug()
        until(process.stderr, 'reading')
        until(process.stderr, 'lost')
        process.send_signal(end)
        output, _ = process.communicate(timeout=20)
    assert process.returncode == 0
    assert re.search(r'\d+ frames, \d\d\.\d a second, \d+ lost; zone 9 blinks by 3\d dB', line)
    frames = list(read_frames(tmp_path / 'bag'))
    lost = frames[-1].sequence - frames[0].sequence + 1 - len(frames)
    assert f'{len(frames)} frames, {lost} lost' in output
    at_once = frames_in_real_time(load_scene('coffee'), 30.0, 0, lambda: 10**18)
    sent = {frame.sequence: frame for frame, _ in at_once}
    for frame in frames:
        true = sent[frame.sequence]
        np.testing.assert_allclose(frame.signal, true.signal, atol=1 / 2048)
        np.testing.assert_array_equal(frame.status, true.status)
    errors_ns = [frame.stamp_ns - sensor.middle_ns[frame.sequence] for frame in frames]
    assert np.median(np.abs(errors_ns)) < 20e6  # a busy host may have been late with some
    gaps_ns = np.diff([frame.stamp_ns for frame in frames])
    assert gaps_ns.min() > 0
    assert gaps_ns.max() > 0.2e9


def test_no_frame_is_explained_is_an_exit_code_and_leaves_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with PortLink(tmp_path / 'port'):
        options = ['-o', str(tmp_path / 'bag'), '--duration', '1.5']
        assert main(['record', str(tmp_path / 'port'), *options]) == 1
    output = capsys.readouterr()
    assert '0 frames, 0.0 a second, 0 lost; nothing comes: is the' in output.err
    assert 'no frame came' in output.out
    assert list(tmp_path.iterdir()) == []
