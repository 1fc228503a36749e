# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import os
import select
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import pytest

from retrolidar_ros.cli import processes
from retrolidar_ros.cli.processes import ProcessError, ProcessGroup

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
        self._end = os.open(path, os.O_RDONLY | os.O_NONBLOCK)

    def command(self, program: str) -> list[str]:
        return ['sh', '-c', f'exec 3>"{self.path}"; {program}']

    def wait_for(self, text: str, timeout_s: float = 10) -> None:
        """Read until `text` has come."""
        data = b''
        deadline_s = time.monotonic() + timeout_s
        while text not in data.decode():
            assert self._readable(deadline_s), f'no {text} in {data!r}'
            chunk = os.read(self._end, 4096)
            assert chunk, f'all ended after {data!r}'
            data += chunk

    def all_gone(self, timeout_s: float = 10) -> bool:
        """Wait until no process holds the other end; return False after the timeout."""
        deadline_s = time.monotonic() + timeout_s
        while self._readable(deadline_s):
            if not os.read(self._end, 4096):
                return True
        return False

    def _readable(self, deadline_s: float) -> bool:
        return bool(select.select([self._end], [], [], max(0, deadline_s - time.monotonic()))[0])

    def close(self) -> None:
        os.close(self._end)


@pytest.fixture
def line(tmp_path: Path) -> Iterator[LifeLine]:
    line = LifeLine(tmp_path / 'line')
    yield line
    line.close()


def await_end(group: ProcessGroup, name: str) -> None:
    """Wait until a process has ended, but leave it to the group to take note of that."""
    os.waitid(os.P_PID, group.pid(name), os.WEXITED | os.WNOWAIT)


@pytest.mark.parametrize('program', [SLEEPER, PARENT, ABANDONING])
def test_leaving_ends_children_and_theirs(tmp_path: Path, line: LifeLine, program: str) -> None:
    with ProcessGroup(tmp_path) as group:
        group.start('one', line.command(program))
        group.start('other', line.command(program))
        line.wait_for('ready\nready')
        assert not line.all_gone(0.05)
    assert line.all_gone()


SIGTERM = partial(signal.raise_signal, signal.SIGTERM)


def raise_error(error: type[BaseException]) -> None:
    raise error


@pytest.mark.parametrize(
    ('end', 'raised'),
    [
        *(
            (partial(raise_error, error), error)
            for error in (ValueError, KeyboardInterrupt, SystemExit)
        ),
        (partial(signal.raise_signal, signal.SIGINT), KeyboardInterrupt),
        (SIGTERM, SystemExit),
    ],
)
def test_an_exception_or_a_signal_ends_them_too_and_passes_on(
    tmp_path: Path, line: LifeLine, end: Callable[[], None], raised: type[BaseException]
) -> None:
    before = signal.getsignal(signal.SIGTERM)

    def work() -> None:
        with ProcessGroup(tmp_path) as group:
            group.start('parent', line.command(PARENT))
            line.wait_for('ready')
            end()

    with pytest.raises(raised) as caught:
        work()
    if end == SIGTERM:
        assert caught.value.args == (128 + signal.SIGTERM,)
    assert line.all_gone()
    assert signal.getsignal(signal.SIGTERM) is before


def test_children_are_asked_by_sigint_first(tmp_path: Path, line: LifeLine) -> None:
    tidy = "trap 'echo tidied >&3; exit 7' INT; echo ready >&3; sleep 60 & wait"
    with ProcessGroup(tmp_path) as group:
        group.start('tidy', line.command(tidy))
        line.wait_for('ready')
        assert group.stop('tidy') == 7
        line.wait_for('tidied')
        assert line.all_gone()


def test_a_child_that_ignores_sigint_is_killed(
    tmp_path: Path, line: LifeLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(processes, '_PATIENCE_S', 0.1)
    with ProcessGroup(tmp_path) as group:
        group.start('stubborn', line.command(STUBBORN))
        line.wait_for('ready')
        assert group.stop('stubborn') == -signal.SIGKILL
        assert line.all_gone()


def test_a_second_ctrl_c_is_no_way_out_for_the_children(tmp_path: Path, line: LifeLine) -> None:
    # Instead of ending, the first child interrupts the waiting for it.
    impatient = (
        f"trap 'kill -INT {os.getpid()}' INT; echo ready >&3; while :; do sleep 60 & wait; done"
    )

    def work() -> None:
        with ProcessGroup(tmp_path) as group:
            group.start('impatient', line.command(impatient))
            group.start('stubborn', line.command(STUBBORN))
            line.wait_for('ready\nready')

    begin_s = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        work()
    assert line.all_gone()
    assert time.monotonic() - begin_s < processes._PATIENCE_S


def test_check_reports_the_child_that_ended_and_the_end_of_its_log(
    tmp_path: Path, line: LifeLine
) -> None:
    program = 'for i in $(seq 1 40); do echo "line $i"; done; echo oops >&2; exit 3'
    lines = '\n'.join(f'line {number}' for number in range(27, 41))
    with ProcessGroup(tmp_path) as group:
        group.check()
        group.start('sleeper', line.command(SLEEPER))
        line.wait_for('ready')
        group.check()
        group.start('failing', ['sh', '-c', program])
        await_end(group, 'failing')
        with pytest.raises(ProcessError) as caught:
            group.check()
        assert str(caught.value) == f'failing ended with exit code 3:\n{lines}\noops'
    assert line.all_gone()
    with ProcessGroup(tmp_path) as group:
        group.start('killed', ['sh', '-c', 'kill -9 $$'])
        await_end(group, 'killed')
        with pytest.raises(ProcessError, match='killed ended with exit code -9'):
            group.check()


def test_a_log_of_any_bytes_can_be_reported(tmp_path: Path) -> None:
    with ProcessGroup(tmp_path) as group:
        group.start('odd', ['sh', '-c', r"printf 'a\377b'"])
        await_end(group, 'odd')
        with pytest.raises(ProcessError, match='odd ended with exit code 0:\na�b'):
            group.check()


def test_a_stopped_process_may_be_started_again(tmp_path: Path, line: LifeLine) -> None:
    again = LifeLine(tmp_path / 'again')
    with ProcessGroup(tmp_path) as group:
        for one in (line, again):
            group.start('sleeper', one.command(SLEEPER))
            one.wait_for('ready')
            with pytest.raises(ValueError, match='sleeper has been started already'):
                group.start('sleeper', one.command(SLEEPER))
            # So Ctrl-C in a terminal does not reach it past the group.
            pid = group.pid('sleeper')
            assert os.getpgid(pid) == pid != os.getpgrp()
            assert group.stop('sleeper') == -signal.SIGINT
            group.check()
            assert one.all_gone()
    again.close()


def test_a_program_that_is_missing_ends_the_others(tmp_path: Path, line: LifeLine) -> None:
    with suppress(FileNotFoundError), ProcessGroup(tmp_path) as group:
        group.start('sleeper', line.command(SLEEPER))
        line.wait_for('ready')
        group.start('missing', [str(tmp_path / 'nothing')])
        pytest.fail('it was started')
    assert line.all_gone()


def test_both_outputs_are_in_the_log_and_there_is_no_input(tmp_path: Path) -> None:
    with ProcessGroup(tmp_path) as group:
        group.start('talker', ['sh', '-c', 'echo out; echo err >&2; read line || echo end'])
        await_end(group, 'talker')
        assert group.log('talker') == tmp_path / 'talker.log'
        assert group.log('talker').read_text() == 'out\nerr\nend\n'
