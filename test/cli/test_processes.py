# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import os
import select
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from retrolidar_ros.cli import processes
from retrolidar_ros.cli.processes import ProcessError, ProcessGroup
from retrolidar_ros.settings.interrupts import interrupted_once, termination_noted

# Programs of a shell. Descriptor 3 is the life line: it reaches its end when all that hold it,
# children's children included, have ended.
SLEEPER = 'echo ready >&3; exec sleep 60'
PARENT = 'sleep 60 & echo ready >&3; wait'
STUBBORN = "trap '' INT; echo ready >&3; while :; do sleep 60; done"
# Its own child outlives its parent, and ignores SIGINT as all background jobs of a shell do.
ABANDONING = 'sleep 60 & echo ready >&3; exit 0'


class LifeLine:
    """A pipe by name, of which the children hold the other end."""

    def __init__(self, path: Path) -> None:
        os.mkfifo(path)
        self.path = path
        self.end = os.open(path, os.O_RDONLY | os.O_NONBLOCK)

    def command(self, program: str) -> list[str]:
        return ['sh', '-c', f'exec 3>"{self.path}"; {program}']

    def read(self, timeout_s: float = 10) -> bytes:
        """Return what has come; nothing when no process holds the other end any more."""
        if not select.select([self.end], [], [], timeout_s)[0]:
            raise TimeoutError
        return os.read(self.end, 4096)

    def wait_for(self, text: bytes) -> None:
        data = b''
        while text not in data:
            data += (chunk := self.read())
            assert chunk, f'all ended after {data!r}'

    def all_gone(self) -> bool:
        """Wait until no process holds the other end."""
        while self.read():
            pass
        return True


@pytest.fixture
def line(tmp_path: Path) -> Iterator[LifeLine]:
    line = LifeLine(tmp_path / 'line')
    yield line
    os.close(line.end)


@pytest.mark.parametrize('program', [SLEEPER, PARENT, ABANDONING])
def test_leaving_ends_children_and_theirs(tmp_path: Path, line: LifeLine, program: str) -> None:
    with ProcessGroup(tmp_path) as group:
        group.start('one', line.command(program))
        group.start('other', line.command(program))
        line.wait_for(b'ready\nready')
        # So Ctrl-C in a terminal does not reach it past the group.
        assert os.getpgid(group.pid('one')) == group.pid('one') != os.getpgrp()
        with pytest.raises(TimeoutError):
            line.read(0.05)
    assert line.all_gone()


@pytest.mark.parametrize(
    ('end', 'raised'),
    [
        (ValueError(), ValueError),
        (KeyboardInterrupt(), KeyboardInterrupt),
        (signal.SIGINT, KeyboardInterrupt),
        (signal.SIGTERM, SystemExit),
        (signal.SIGHUP, SystemExit),
    ],
)
def test_an_exception_or_a_signal_ends_them_too_and_passes_on(
    tmp_path: Path, line: LifeLine, end: BaseException | signal.Signals, raised: type[BaseException]
) -> None:
    before = signal.getsignal(signal.SIGTERM)

    def work() -> None:
        with ProcessGroup(tmp_path) as group:
            group.start('parent', line.command(PARENT))
            line.wait_for(b'ready')
            if isinstance(end, BaseException):
                raise end
            signal.raise_signal(end)

    with pytest.raises(raised) as caught:
        work()
    if raised is SystemExit:
        assert caught.value.args == (128 + end,)  # type: ignore[operator]
    assert line.all_gone()
    assert signal.getsignal(signal.SIGTERM) is before


@pytest.mark.parametrize('begin', [ProcessGroup, interrupted_once, termination_noted])
def test_a_hangup_that_nohup_ignores_stays_ignored(
    tmp_path: Path, begin: Callable[..., Any]
) -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with begin(*([tmp_path] if begin is ProcessGroup else [])) as begun:
            signal.raise_signal(signal.SIGHUP)
            assert begin is not termination_noted or not begun.is_set()
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_a_child_that_ignores_sigint_is_killed(
    tmp_path: Path, line: LifeLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, '_PATIENCE_S', 0.1)
    with ProcessGroup(tmp_path) as group:
        group.start('stubborn', line.command(STUBBORN))
        line.wait_for(b'ready')
        assert group.stop('stubborn') == -signal.SIGKILL
        assert line.all_gone()


def test_a_child_ends_with_a_parent_that_is_killed(tmp_path: Path, line: LifeLine) -> None:
    script = (
        'import sys, time; from pathlib import Path\n'
        'from retrolidar_ros.cli.processes import ProcessGroup\n'
        'with ProcessGroup(Path(sys.argv[1])) as group:\n'
        "    group.start('child', sys.argv[2:]); time.sleep(100)\n"
    )
    command = [sys.executable, '-c', script, str(tmp_path), *line.command(SLEEPER)]
    with subprocess.Popen(command) as parent:
        line.wait_for(b'ready')
        parent.kill()
    assert line.all_gone()


def test_check_reports_who_ended_and_the_end_of_its_log(tmp_path: Path, line: LifeLine) -> None:
    program = 'for i in $(seq 1 40); do echo "line $i"; done; echo oops >&2; exit 3'
    lines = '\n'.join(f'line {number}' for number in range(27, 41))
    with ProcessGroup(tmp_path) as group:
        group.check()
        group.start('sleeper', line.command(SLEEPER))
        line.wait_for(b'ready')
        group.check()
        group.start('failing', ['sh', '-c', program])
        os.waitid(os.P_PID, group.pid('failing'), os.WEXITED | os.WNOWAIT)
        with pytest.raises(ProcessError) as caught:
            group.check()
        assert str(caught.value) == f'failing ended with exit code 3:\n{lines}\noops'
    assert line.all_gone()
