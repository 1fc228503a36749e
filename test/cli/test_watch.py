# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command `retrolidar watch`, in a log and in a terminal."""

import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from fcntl import ioctl
from pathlib import Path
from struct import pack
from termios import TIOCSWINSZ

import pytest
from st_board import Board, Zone

from retrolidar_ros.cli.main import main

Output = pytest.CaptureFixture[str]
COFFEE = {'2073', '2096', '2107'}
COMMAND = [sys.executable, '-m', 'retrolidar_ros.cli']
PATIENCE_S = 60.0


def test_a_still_scene_before_st_s_example_does_not_blink(capsys: Output) -> None:
    options = ['--protocol', 'st_example', '--bit-period', '0.1', '--duration', '3']
    with Board([Zone(700, signal_kcps=250)] * 16) as board, board.printing():
        assert main(['watch', board.path, *options]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert int(re.findall(r'(\d+) frames,', last)[0]) > 10
    assert last.endswith('no zone blinks')


def test_a_missing_port_is_told_even_to_a_closed_output(tmp_path: Path, capsys: Output) -> None:
    assert main(['watch', str(tmp_path / 'port'), '--duration', '0.3']) == 1
    (line,) = capsys.readouterr().out.splitlines()
    assert 'port does not exist; is the sensor plugged in?; retrying; 0.0 frames/s' in line
    command = [*COMMAND, 'watch', str(tmp_path / 'port'), '--duration', '0.1']
    shell = ['sh', '-c', '"$@" >&-', 'sh', *command]
    result = subprocess.run(shell, stderr=subprocess.PIPE, text=True, timeout=PATIENCE_S)
    assert (result.returncode, result.stderr) == (1, '')


@pytest.fixture(scope='module')
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Give the port of an emulated sensor that sees the coffee scene."""
    path = tmp_path_factory.mktemp('coffee') / 'port'
    command = [*COMMAND, 'emulate', 'coffee', '--port-link', str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert 'a sensor is at' in process.stdout.readline()
        yield path
        process.send_signal(signal.SIGINT)
        process.stdout.read()


def test_a_log_has_a_line_a_second(port: Path, capsys: Output) -> None:
    began_s = time.monotonic()
    assert main(['watch', str(port), '--duration', '4']) == 0
    assert time.monotonic() - began_s > 4
    output = capsys.readouterr()
    assert output.err == ''
    assert '\x1b' not in output.out
    lines = output.out.splitlines()
    assert 2 <= len(lines) <= 5
    assert re.search(r' 0 damaged packets; zone 9: .* kcps/SPAD, .* blinking 3\d\.\d dB', lines[-1])
    assert set(re.findall(r'last ID (\d+) at', output.out)) <= COFFEE
    assert 'last ID' in lines[-1]


@pytest.mark.parametrize('request_to_end', [signal.SIGINT, signal.SIGTERM])
def test_a_terminal_shows_ids_and_is_restored(port: Path, request_to_end: signal.Signals) -> None:
    master, slave = pty.openpty()
    ioctl(slave, TIOCSWINSZ, pack('HHHH', 30, 100, 0, 0))
    env = {**os.environ, 'TERM': 'linux', 'PYTHONIOENCODING': 'utf-8'}
    env.pop('COLUMNS', None)
    env.pop('LINES', None)
    process = subprocess.Popen([*COMMAND, 'watch', str(port)], stdin=slave, stdout=slave, env=env)
    os.close(slave)
    shown = b''

    def read() -> bool:
        nonlocal shown
        if not select.select([master], [], [], PATIENCE_S)[0]:
            return False
        try:
            shown += os.read(master, 65536)
        except OSError:  # the other end is closed
            return False
        return True

    def pictures() -> list[str]:
        return shown.decode(errors='replace').split('\x1b[H')

    def read_all() -> bool:
        return len(pictures()) > 2 and all(text in pictures()[-2] for text in COFFEE)

    try:
        while not read_all():
            assert read(), pictures()[-1]
        process.send_signal(request_to_end)
        while read():
            pass
        assert process.wait(PATIENCE_S) == 0
    finally:
        process.kill()
        process.wait()
        os.close(master)
    assert shown.startswith(b'\x1b[?25l')
    assert shown.endswith(b'\x1b[?25h')
    picture = pictures()[-2].replace('\x1b[K', '').splitlines()
    assert max(map(len, picture)) <= 100
    assert any('>9  ====' in text for text in picture)
