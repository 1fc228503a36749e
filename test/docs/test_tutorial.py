# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The tutorial does what it says: what it tells its reader is done, and the output compared.

``bash`` blocks run in one shell; ``python`` and ``yaml`` blocks are saved as the line before says;
a ``text`` block is the output, with "…" for any text or lines; a ``console`` block is not run.
"""

import os
import re
import shutil
import signal
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import pytest

_BLOCK = re.compile(r'^```(\w+)\n(.*?)^```$', re.DOTALL | re.MULTILINE)
_SAVE = re.compile(r'Save as\s+`([^`\s]+)`:\s*\Z')
_END = '__end_of_file__'


def script_of(page: str, logs: Path) -> tuple[str, dict[int, str | None]]:
    """Return a page's shell script, which logs by line number, and what each log must match."""
    script = ['set -euo pipefail']
    expected: dict[int, str | None] = {}
    last = end = 0
    for block in _BLOCK.finditer(page):
        kind, text = block.groups()
        between, end = page[end : block.start()], block.end()
        line = page.count('\n', 0, block.start()) + 1
        if kind == 'bash':
            script.append(f"exec > '{logs / str(line)}' 2>&1\n{text}")
            last, expected[line] = line, None
        elif kind in ('python', 'yaml'):
            save = _SAVE.search(between)
            assert save, f'line {line}: this block has no "Save as `NAME`:" before it'
            script.append(f"cat > '{save[1]}' <<'{_END}'\n{text}{_END}")
        elif kind == 'text':
            is_after = bool(last) and not between.strip()
            assert is_after, f'line {line}: there are no commands before this'
            expected[last] = text
        else:
            assert kind == 'console', f'line {line}: unknown kind of block {kind}'
    return '\n'.join(script), expected


def matches(expected: str, output: str) -> bool:
    """Return whether an output is as a page says."""
    lines = (map(re.escape, line.split('…')) for line in expected.splitlines())
    patterns = (
        r'(?:.*\n)*' if parts == ['', ''] else '.*'.join(parts) + r'\n'
        for parts in map(list, lines)
    )
    return re.fullmatch(''.join(patterns), output) is not None


def run_page(page: str, directory: Path, env: Mapping[str, str], timeout_s: float) -> None:
    """Do everything that a page says in an empty directory, and check all outputs."""
    logs = directory.with_name(f'{directory.name}_output')
    logs.mkdir()
    script, expected = script_of(page, logs)
    shell = subprocess.Popen(
        ['bash', '-c', script],
        cwd=directory,
        # What a command prints and what it says to stderr then come in the order of a terminal.
        env={**env, 'PYTHONUNBUFFERED': '1'},
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )
    code, left_over = None, False
    with suppress(subprocess.TimeoutExpired):
        code = shell.wait(timeout_s)
    with suppress(ProcessLookupError):
        os.killpg(shell.pid, signal.SIGKILL)
        left_over = code is not None
    shell.wait()
    last = 'nothing was run'
    for line, text in expected.items():
        log = logs / str(line)
        if log.exists():
            output = log.read_text(encoding='utf-8')
            last = f'line {line}: exit code {code}, and the output is\n{output}'
            assert text is None or matches(text, output), last
    assert code == 0, last
    assert not left_over, 'a process of the page is still running at its end'


TUTORIAL = Path(__file__).parents[2] / 'docs' / 'tutorial.md'


def test_the_tutorial(tmp_path: Path) -> None:
    pytest.importorskip('rclpy', reason='needs ROS 2')
    pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')
    pytest.importorskip('rosbags', reason='needs rosbags, which is a pip extra')
    pytest.importorskip('matplotlib', reason='needs matplotlib, which is a pip extra')
    command = shutil.which('retrolidar')
    if command is None or not (Path(command).parents[1] / 'lib/retrolidar_ros/detector').exists():
        pytest.skip('needs the executables on PATH: source install/setup.bash, or embedded/run')
    directory = tmp_path / 'bench'
    directory.mkdir()
    # Its topics are those of a robot; other tests and robots are in other domains.
    env = {**os.environ, 'ROS_DOMAIN_ID': str(1 + os.getpid() % 100)}
    run_page(TUTORIAL.read_text(encoding='utf-8'), directory, env, 110.0)
