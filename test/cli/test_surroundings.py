# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command in poor surroundings, and what a full disk or a signal leaves behind of it."""

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest
from harness_firmware import run
from harness_frames import make_frames

from retrolidar_ros import cli
from retrolidar_ros.bag import FrameWriter, messages, read_frames
from retrolidar_ros.bag.messages import BagError
from retrolidar_ros.sensor.frame import Frame

# Not -m: that finds the sources first, which have no messages.
PROGRAM = [sys.executable, str(Path(cli.__file__).with_name('__main__.py'))]
PATIENCE_S = 60.0


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_disk_that_is_full_keeps_what_was_recorded(tmp_path: Path, storage: str) -> None:
    """A limit on the size of a file refuses to write as a full disk does."""
    pytest.importorskip('rosbags', reason='bags are written with rosbags')
    limit = partial(resource.setrlimit, resource.RLIMIT_FSIZE, (400_000, 400_000))
    command = [*PROGRAM, 'emulate', 'coffee', '--duration', '120', '--storage', storage]
    result = subprocess.run(
        [*command, '--bag', str(tmp_path / 'bag')],
        capture_output=True,
        text=True,
        preexec_fn=limit,
        timeout=PATIENCE_S,
        check=False,
    )
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1, result.stderr
    frames: list[Frame] = []
    with suppress(BagError):  # an mcap says that the recording did not end properly
        frames.extend(read_frames(tmp_path / 'bag'))
    assert len(frames) >= 500
    assert [frame.sequence for frame in frames] == list(range(len(frames)))


def test_what_was_unpacked_goes_with_a_command_that_is_ended(tmp_path: Path) -> None:
    pytest.importorskip('rosbags', reason='bags are written with rosbags')
    zstd = pytest.importorskip(messages._ZSTD)
    with FrameWriter(tmp_path / 'bag') as bag:
        for frame in make_frames(20_000):
            bag.write(frame)
    (mcap,) = (tmp_path / 'bag').glob('*.mcap')
    packed = tmp_path / 'packed.mcap.zstd'
    packed.write_bytes(zstd.compress(mcap.read_bytes()))
    unpacked = tmp_path / 'unpacked'
    unpacked.mkdir()
    environment = {**os.environ, 'TMPDIR': str(unpacked)}
    with subprocess.Popen([*PROGRAM, 'decode', str(packed)], env=environment) as process:
        deadline_s = time.monotonic() + PATIENCE_S
        while not list(unpacked.glob('*/*')):
            assert time.monotonic() < deadline_s, 'nothing is unpacked'
            time.sleep(0.005)
        process.send_signal(signal.SIGTERM)
    assert process.returncode == 128 + signal.SIGTERM
    assert not list(unpacked.iterdir())


ABSENT = (
    "import sys; sys.modules['serial'] = None; sys.argv[1:] = ['demo']\n"
    'from retrolidar_ros.cli.__main__ import main; sys.exit(main())\n'
)


def test_a_locale_that_lacks_characters_costs_those_only() -> None:
    for command in ('ids', 'budget', 'decode'):
        result = run(*PROGRAM, command, '--help', PYTHONIOENCODING='iso-8859-1', PYTHONUTF8='0')
        assert result.returncode == 0, result.stderr
    result = run(*PROGRAM, '--help', LC_ALL='C', PYTHONUTF8='0', PYTHONCOERCECLOCALE='0')
    assert result.returncode == 0, result.stderr


def test_a_missing_library_is_named_as_pip_knows_it() -> None:
    result = run(sys.executable, '-c', ABSENT)
    assert result.returncode == 2
    assert result.stderr.splitlines()[-1].endswith(b'pip install pyserial')


@pytest.mark.parametrize('delay_s', [0.05, 0.1, 0.2, 0.4])
def test_an_interrupt_at_any_time_leaves_no_traceback(delay_s: float) -> None:
    with subprocess.Popen([*PROGRAM, 'watch', '/nowhere'], stderr=subprocess.PIPE) as process:
        time.sleep(delay_s)  # how far it is then, nobody tells: that is the point
        process.send_signal(signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=5)
        except subprocess.TimeoutExpired:  # Python loses one that comes in a callback of an import
            process.send_signal(signal.SIGINT)
            _, errors = process.communicate(timeout=20)
    # Python itself, before it has come to more than the program's first imports, is not ours.
    lines = re.findall(rb'retrolidar_ros\S+\.py", line .*\n +(\w+)', errors)
    assert set(lines) <= {b'from', b'import'}, errors


def test_tools_of_ros_that_are_not_there_are_named_with_what_does_the_same() -> None:
    root = Path(__file__).parents[2]
    if not (root / '.venv').exists() or shutil.which('ros2'):
        pytest.skip('needs the environment of make build, without the tools of ROS')
    result = run(root / 'embedded' / 'run', 'ros2', 'bag', 'play', 'x')
    assert result.returncode == 127
    (line,) = result.stderr.splitlines()
    assert b'retrolidar watch, record, replay' in line
