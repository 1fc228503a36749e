# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The firmware compiled for this machine, with sanitizers, and spoken to from Python."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import pytest
from numpy.typing import NDArray

from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.wire import FrameReader

ROOT = Path(__file__).resolve().parent.parent
FIRMWARE = ROOT / 'firmware'
TIME_LIMIT_S = 120.0

IntArray: TypeAlias = NDArray[np.integer]


def make(directory: Path, build: Path, *targets: object) -> str:
    """Make targets of a Makefile; return what it printed, or fail with that."""
    # What colcon or a person set for other builds is not for this one.
    unwanted = dict.fromkeys(('CFLAGS', 'CXXFLAGS', 'LDFLAGS', 'MAKEFLAGS', 'MFLAGS'), '')
    build.mkdir(exist_ok=True)
    with (build / 'lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # another worker of pytest-xdist may want the same
        return printed('make', '-j2', '-C', directory, f'BUILD={build}', *targets, **unwanted)


def need(*tools: str) -> None:
    """Skip the test where a program is not installed."""
    for tool in tools:
        if shutil.which(tool) is None:
            pytest.skip(f'needs {tool}, which is not installed')


def shared_build(directories: pytest.TempPathFactory, name: str) -> Path:
    """Return where all tests of a run, in whatever process, make their programs."""
    base = directories.getbasetemp()
    return (base.parent if 'PYTEST_XDIST_WORKER' in os.environ else base) / name


def run(
    *command: object, given: str = '', **environment: str
) -> subprocess.CompletedProcess[bytes]:
    """Return how a command ended."""
    return subprocess.run(
        [*map(str, command)],
        input=given.encode(),
        capture_output=True,
        check=False,
        timeout=TIME_LIMIT_S,
        env={**os.environ, **environment},
    )


def printed(*command: object, **environment: str) -> str:
    """Return what a command prints, which must end well."""
    ended = run(*command, **environment)
    assert ended.returncode == 0, (ended.stdout + ended.stderr).decode()
    return ended.stdout.decode()


def run_host(program: Path, *arguments: object, given: str = '', **environment: str) -> bytes:
    """Run a compiled sketch; return its output, and fail if a sanitizer complains."""
    ended = run(program, *arguments, given=given, **environment)
    assert not ended.stderr, ended.stderr.decode()
    return ended.stdout


class RawFrame(NamedTuple):
    """A frame in the sensor's raw units, its zones in the sensor's own order: arrays (zones,)."""

    sequence: int
    time_us: int
    distance: IntArray
    signal: IntArray
    ambient: IntArray
    status: IntArray

    @property
    def zones(self) -> int:
        return len(self.status)

    @property
    def rows(self) -> int:
        return int(self.zones**0.5)

    @classmethod
    def of(cls, frame: Frame) -> RawFrame:
        """Return what the sensor must have measured for a frame to come out."""
        shape = (frame.grid.rows, frame.grid.columns)

        def turned(values: NDArray[Any], scale: float) -> IntArray:
            raw = np.rint(np.nan_to_num(values.astype(np.float64)) * scale).astype(np.int64)
            return raw.reshape(shape)[:, ::-1].ravel()

        scales = {'distance': 4000.0, 'signal': 2048.0, 'ambient': 2048.0, 'status': 1.0}
        zones = {name: turned(getattr(frame, name), scale) for name, scale in scales.items()}
        return cls(frame.sequence, frame.sensor_time_us, **zones)


def assert_same_zones(frame: Frame, raw: RawFrame) -> None:
    """Compare all that a frame tells of its zones."""
    again = RawFrame.of(frame)
    for name in ('distance', 'signal', 'ambient', 'status'):
        np.testing.assert_array_equal(getattr(again, name), getattr(raw, name))


def read_line(data: bytes) -> tuple[list[Frame], FrameReader]:
    """Return all frames on the line, and the reader with its counts."""
    reader = FrameReader()
    return reader.feed(data), reader
