# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Does what a Markdown page tells its reader to do, and compares what comes out.

``bash`` blocks run in order in one shell. A ``python`` or ``yaml`` block after a line with "Save as
`NAME`:" is written to that file. A ``text`` block after a ``bash`` block is its output, in which
"…" stands for any text of a line, and a line of "…" for any lines. All other blocks are for people.
"""

import os
import re
import signal
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

_BLOCK = re.compile(r'^```(\w+)\n(.*?)^```$', re.DOTALL | re.MULTILINE)
_SAVE = re.compile(r'Save as\s+`([^`\s]+)`:\s*\Z')
_END = '__end_of_file__'


class Step(NamedTuple):
    """One file to write, or one block of commands to run."""

    line: int
    text: str
    file: str | None = None
    expected: str | None = None


def parse(page: str) -> list[Step]:
    """Return what a page tells its reader to do."""
    steps: list[Step] = []
    end = 0
    for block in _BLOCK.finditer(page):
        kind, text = block.groups()
        between, end = page[end : block.start()], block.end()
        line = page.count('\n', 0, block.start()) + 1
        if kind == 'bash':
            steps.append(Step(line, text))
        elif kind in ('python', 'yaml'):
            save = _SAVE.search(between)
            if save is None:
                raise ValueError(f'line {line}: this block has no "Save as `NAME`:" before it')
            steps.append(Step(line, text, file=save[1]))
        elif kind == 'text':
            if between.strip() or not steps or steps[-1].file or steps[-1].expected is not None:
                raise ValueError(f'line {line}: there are no commands whose output this could be')
            steps[-1] = steps[-1]._replace(expected=text)
        elif kind != 'console':
            raise ValueError(f'line {line}: unknown kind of block {kind}')
    return steps


def matches(expected: str, output: str) -> bool:
    """Tell whether an output is as a page says."""
    pattern = ''
    for line in expected.splitlines():
        if line.strip() == '…':
            pattern += r'(?:.*\n)*'
        else:
            pattern += '.*'.join(map(re.escape, line.split('…'))) + r'\n'
    return re.fullmatch(pattern, output) is not None


def run_page(page: str, directory: Path, env: Mapping[str, str], timeout_s: float) -> None:
    """Do everything that a page says in an empty directory.

    Raises
    ------
    AssertionError
        If a command fails or prints something else, or all takes too long.
    """
    steps = parse(page)
    logs = directory.with_name(f'{directory.name}_output')
    logs.mkdir()
    script = ['set -euo pipefail']
    for step in steps:
        if step.file:
            script.append(f"cat > '{step.file}' <<'{_END}'\n{step.text}{_END}")
        else:
            script.append(f"exec > '{logs / str(step.line)}' 2>&1\n{step.text}")
    shell = subprocess.Popen(
        ['bash', '-c', '\n'.join(script)],
        cwd=directory,
        # What a command prints and what it says to stderr then come in the order of a terminal.
        env={**env, 'PYTHONUNBUFFERED': '1'},
        stdin=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        code: int | str = shell.wait(timeout_s)
    except subprocess.TimeoutExpired:
        code = f'none, for it took longer than {timeout_s:g} s'
    finally:
        try:
            os.killpg(shell.pid, signal.SIGKILL)
            left_over = shell.returncode is not None
        except ProcessLookupError:
            left_over = False
        shell.wait()
    for step in steps:
        log = logs / str(step.line)
        if step.file or not log.exists():
            continue
        output = log.read_text(encoding='utf-8')
        if step.expected is not None and not matches(step.expected, output):
            raise AssertionError(f'line {step.line}: exit code {code}, and the output is\n{output}')
        last = f'line {step.line}, the last that was run, printed\n{output}'
    assert code == 0, f'exit code {code}; {last}'
    assert not left_over, 'a process of the page is still running at its end'
