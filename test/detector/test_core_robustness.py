# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whatever the core is given: no fault, no memory taken; on any processor, for any sensor."""

import importlib
import json
import re
import shutil
import sys
import sysconfig
from pathlib import Path

import numpy as np
import pytest
from harness_core import PROGRAMS, SOURCES, compile_core
from harness_firmware import ROOT, need, printed, run

from retrolidar_ros import core

STRICT = ['-std=c99', '-Wall', '-Wextra', '-Wpedantic', '-Wconversion', '-Wshadow', '-Werror']
RUNS = ((10, 7, 200), (1140, 1, 1200))
"""First detector, how many, and frames of each; the last reads one as long as what is held."""
LISTED = re.compile(r'\d+: \d+ zones, \d+ IDs: (\d+) candidates, (\d+) read')
# The processor of this machine is what the programs of these tests are compiled for.
PROCESSORS = {
    'ARM64': ('aarch64-linux-gnu-gcc', ()),
    'Cortex-M4': ('arm-none-eabi-gcc', ('-mcpu=cortex-m4', '-mthumb')),
}


@pytest.mark.timeout(600)  # half a minute on a fast machine that does nothing else
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
    assert candidates > 500
    assert read > 20


def test_memory_is_taken_at_creation_only_and_no_state_is_kept(
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    need('objdump', 'nm')
    archive = compile_core('plain.a', tmp_path_factory)
    takers = {
        heading
        for heading, symbols in re.findall(
            r'FOR \[\.(\S+)\]:\n(.*?)\n\n', printed('objdump', '-r', archive), re.S
        )
        if re.search(r'\b(\w*alloc|free|strn?dup)\b', symbols)
    }
    objects = ('detector', 'tracks')
    assert takers == {f'text.rl_{one}_{end}' for one in objects for end in ('create', 'destroy')}
    symbols = printed('nm', archive)
    assert symbols.count('.o:\n') == len(list(SOURCES.glob('*.c')))
    assert re.findall(r'^\S* [bBcCdDsSgG] .*$', symbols, re.M) == []


@pytest.mark.parametrize('processor', PROCESSORS)
def test_the_core_compiles_without_a_warning(processor: str, tmp_path: Path) -> None:
    compiler, options = PROCESSORS[processor]
    need(compiler)
    headers = '#include <math.h>\n#include <stdlib.h>\n#include <string.h>\n'
    if run(compiler, '-E', '-xc', '-', given=headers).returncode:
        pytest.skip(f'needs a C library for {compiler}')
    for source in SOURCES.glob('*.c'):
        made = ('-c', source, '-o', tmp_path / 'one.o')
        printed(compiler, *STRICT, '-O2', *options, f'-I{SOURCES}', *made)


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


def test_8x8_zones_at_15_hz_and_a_packet_of_27_bits_are_read_by_one_core(tmp_path: Path) -> None:
    pytest.importorskip('cffi')
    need('cc')
    other, made = tmp_path / 'core', tmp_path / '_core.so'
    shutil.copytree(SOURCES.parent, other)
    shutil.copy(PROGRAMS / 'other_packet.h', other / 'src' / 'retrolidar_packet_format.h')
    printed(sys.executable, other / 'binding.py', tmp_path / '_core.c')
    include = (f'-I{other / "src"}', f'-I{sysconfig.get_paths()["include"]}')
    sources = (tmp_path / '_core.c', *(other / 'src').glob('*.c'))
    printed('cc', '-std=c99', '-shared', '-fPIC', '-O1', *include, *sources, '-lm', '-o', made)
    said = printed(sys.executable, PROGRAMS / 'other_packet.py', made)
    found, by_another_model = said.splitlines()
    detections = json.loads(found)
    # ID, zone and start of the three that are sent once.
    assert {(one[0], one[3], round(one[2], 1)) for one in detections if one[0] != 500} == {
        (100, 9, 5.0),
        (311, 27, 6.4),
        (7, 62, 7.7),
    }
    # The fourth repeats.
    packets = [(one[2] - 3.0) / (27 * 0.133) for one in detections if one[0] == 500]
    assert len(packets) >= 3
    assert packets == pytest.approx(np.rint(packets), abs=0.01)
    assert [one[1] for one in detections] == pytest.approx([1.2] * len(detections), abs=5e-3)
    # Its statuses mean nothing to a detector that expects a VL53L8CX.
    assert json.loads(by_another_model) == []
