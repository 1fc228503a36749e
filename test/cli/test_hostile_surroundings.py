# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The command with a poor locale, a missing library, odd arguments, or a parent that is killed."""

import os
import re
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest

from retrolidar_ros.settings.printing import printable

PROGRAM = [sys.executable, '-m', 'retrolidar_ros.cli']
ABSENT = """
import sys

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] == 'serial':
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)

sys.meta_path.insert(0, Absent())
sys.argv[1:] = ['demo']
from retrolidar_ros.cli.__main__ import main
sys.exit(main())
"""


def run(*arguments: str, **environment: str) -> subprocess.CompletedProcess[bytes]:
    return subprocess.run(
        [*PROGRAM, *arguments],
        capture_output=True,
        env={**os.environ, **environment},
        timeout=60,
        check=False,
    )


def test_a_locale_that_lacks_characters_costs_those_only() -> None:
    for command in ('ids', 'budget', 'decode'):
        result = run(command, '--help', PYTHONIOENCODING='iso-8859-1', PYTHONUTF8='0')
        assert result.returncode == 0, result.stderr
    assert run('--help', LC_ALL='C', PYTHONUTF8='0', PYTHONCOERCECLOCALE='0').returncode == 0


def test_a_missing_library_is_named_as_pip_knows_it() -> None:
    result = subprocess.run(
        [sys.executable, '-c', ABSENT], capture_output=True, text=True, timeout=60, check=False
    )
    assert result.returncode == 2
    assert result.stderr.splitlines()[-1].endswith('pip install pyserial')


@pytest.mark.parametrize('delay_s', [0.05, 0.1, 0.2, 0.4])
def test_an_interrupt_at_any_time_leaves_no_traceback(delay_s: float) -> None:
    with subprocess.Popen([*PROGRAM, 'watch', '/nowhere'], stderr=subprocess.PIPE) as process:
        time.sleep(delay_s)  # how far it is then, nobody tells: that is the point
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=20)
    # Python itself, before it has come to more than the program's first imports, is not ours.
    lines = re.findall(rb'retrolidar_ros\S+\.py", line .*\n +(\w+)', errors)
    assert set(lines) <= {b'from', b'import'}, errors


def test_what_was_started_ends_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    script = (
        'import sys, time; from pathlib import Path\n'
        'from retrolidar_ros.cli.processes import ProcessGroup\n'
        'with ProcessGroup(Path(sys.argv[1])) as group:\n'
        "    group.start('child', ['sleep', '100'])\n"
        "    print(group.pid('child'), flush=True); time.sleep(100)\n"
    )
    command = [sys.executable, '-c', script, str(tmp_path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        parent.kill()
    deadline = time.monotonic() + 10.0
    with suppress(FileNotFoundError, ProcessLookupError):
        while 'State:\tZ' not in Path(f'/proc/{child}/status').read_text():
            assert time.monotonic() < deadline, 'the child lives on'
            time.sleep(0.01)


def test_control_characters_are_escaped_for_a_terminal() -> None:
    assert printable('a\x1b[31m\r\x9b\nb é') == 'a\\x1b[31m\\r\\x9b\nb é'
    long = printable('x' * 10**6)
    assert len(long) < 1100
    assert '999000 characters' in long
