# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core in C is bound to Python, and the error where it is missing says what to do."""

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from retrolidar_ros import core

ROOT = Path(__file__).resolve().parents[2]
TIME_LIMIT_S = 60.0


def test_arguments_that_the_types_do_not_hold_are_refused() -> None:
    assert core.lib.rl_packet(2073) >> core.lib.RL_WORD_BITS == core.lib.RL_PREAMBLE
    with pytest.raises(OverflowError):
        core.lib.rl_packet(2**16)


def test_a_missing_core_is_reported_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'retrolidar_ros._core', None)
    with pytest.raises(ImportError, match=r'compiled core is missing.*build-essential') as caught:
        importlib.reload(core)
    assert '\n' not in str(caught.value)


def test_an_installation_without_a_compiler_says_what_to_install(tmp_path: Path) -> None:
    pytest.importorskip('cffi')
    pytest.importorskip('setuptools')
    build = ['build_ext', '--build-temp', str(tmp_path), '--build-lib', str(tmp_path)]
    ended = subprocess.run(
        [sys.executable, 'setup.py', *build],
        cwd=ROOT,
        env={**os.environ, 'CC': '/nonexistent'},
        capture_output=True,
        text=True,
        check=False,
        timeout=TIME_LIMIT_S,
    )
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1].startswith('error: retrolidar_ros needs a C compiler')
