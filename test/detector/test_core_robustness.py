# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whatever the core is given: no fault, no memory taken, no state but its own; on any processor."""

import importlib
import re
import sys
from pathlib import Path

import pytest
from harness_core import PROGRAMS, ROOT, SOURCES, compile_core
from harness_firmware import need, printed, run

from retrolidar_ros import core

STRICT = ['-std=c99', '-Wall', '-Wextra', '-Wpedantic', '-Wconversion', '-Wshadow', '-Werror']
RUNS = ((0, 7, 200), (1140, 1, 1200))
"""First detector, how many, and frames of each; the last reads one as long as what is held."""
LISTED = re.compile(r'\d+: \d+ zones, \d+ IDs: (\d+) candidates, (\d+) read')
# The processor of this machine is what the programs of these tests are compiled for.
PROCESSORS = {
    'ARM64': ('aarch64-linux-gnu-gcc', ()),
    'Cortex-M4': ('arm-none-eabi-gcc', ('-mcpu=cortex-m4', '-mthumb')),
}


def test_frames_of_garbage_do_no_harm(tmp_path_factory: pytest.TempPathFactory) -> None:
    library = compile_core('sanitized.so', tmp_path_factory)
    sanitizer = printed('cc', '-print-file-name=libasan.so').strip()
    # Python itself leaves memory at its end.
    given = {'LD_PRELOAD': sanitizer, 'ASAN_OPTIONS': 'detect_leaks=0'}
    candidates = read = 0
    for detectors in RUNS:
        said = printed(sys.executable, PROGRAMS / 'fuzz.py', library, *map(str, detectors), **given)
        listed = LISTED.findall(said)
        assert len(listed) == detectors[1]
        candidates += sum(int(judged) for judged, _ in listed)
        read += sum(int(known) for _, known in listed)
    # Else it would have seen little of the core.
    assert candidates > 300
    assert read > 5


def test_memory_is_taken_at_creation_only(tmp_path_factory: pytest.TempPathFactory) -> None:
    need('objdump')
    listed = printed('objdump', '-r', compile_core('plain.a', tmp_path_factory))
    takers = {
        heading
        for heading, symbols in re.findall(r'FOR \[\.(\S+)\]:\n(.*?)\n\n', listed, re.S)
        if re.search(r'\b(\w*alloc|free|strn?dup)\b', symbols)
    }
    objects = ('detector', 'tracks')
    assert takers == {f'text.rl_{one}_{end}' for one in objects for end in ('create', 'destroy')}


def test_the_core_has_no_state_of_its_own(tmp_path_factory: pytest.TempPathFactory) -> None:
    need('nm')
    symbols = printed('nm', compile_core('plain.a', tmp_path_factory))
    assert symbols.count('.o:\n') == len(list(SOURCES.glob('*.c')))
    assert re.findall(r'^\S* [bBcCdDsSgG] .*$', symbols, re.M) == []


def has_library(compiler: str) -> bool:
    """Tell whether a compiler comes with the headers of a C library."""
    headers = '#include <math.h>\n#include <stdlib.h>\n#include <string.h>\n'
    return run(compiler, '-E', '-xc', '-', given=headers).returncode == 0


@pytest.mark.parametrize('processor', PROCESSORS)
def test_the_core_compiles_without_a_warning(processor: str, tmp_path: Path) -> None:
    compiler, options = PROCESSORS[processor]
    need(compiler)
    if not has_library(compiler):
        pytest.skip(f'needs a C library for {compiler}')
    for source in SOURCES.glob('*.c'):
        made = ('-c', source, '-o', tmp_path / 'one.o')
        printed(compiler, *STRICT, '-O2', *options, f'-I{SOURCES}', *made)


def test_arguments_that_the_types_do_not_hold_are_refused() -> None:
    assert core.lib.rl_packet(2073) >> core.lib.RL_WORD_BITS == core.lib.RL_PREAMBLE
    with pytest.raises(OverflowError):
        core.lib.rl_packet(2**16)


def test_a_missing_core_is_reported_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, 'retrolidar_ros._core', None)
    with pytest.raises(ImportError, match=r'compiled core is missing.*build-essential') as caught:
        importlib.reload(core)
    assert '\n' not in str(caught.value)


def test_a_missing_compiler_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip('cffi')
    pytest.importorskip('setuptools')
    build = ['build_ext', '--build-temp', tmp_path, '--build-lib', tmp_path]
    monkeypatch.chdir(ROOT)
    ended = run(sys.executable, 'setup.py', *build, CC='/nonexistent')
    assert ended.returncode == 1
    assert ended.stderr.splitlines()[-1].startswith(b'error: retrolidar_ros needs a C compiler')
