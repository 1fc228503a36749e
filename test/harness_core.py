# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core compiled for this machine, tried by programs of its own and questioned from Python."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from harness_firmware import Core, make, need, shared_build
from numpy.typing import NDArray
from oracle import Sending, Zone

from retrolidar_ros.core import lib
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid

ROOT = Path(__file__).resolve().parent.parent
SOURCES = ROOT / 'core' / 'src'
PROGRAMS = ROOT / 'test' / 'core'
LAW = NoiseLaw()
GRID = ZoneGrid()
PERIOD_S = 0.021
LEAST_NOISE = 0.5
"""Share of the noise law's variance that a fit may not fall short of."""


def compile_core(program: str, directories: pytest.TempPathFactory) -> Path:
    """Make one of the programs; return its path, or fail with what the compiler said."""
    need('make', 'cc')
    build = shared_build(directories, 'core')
    make(PROGRAMS, build, build / program)
    return build / program


class Rows(NamedTuple):
    """What the core holds of a source, each field of shape (rows,)."""

    period_s: float
    begin_s: Floats
    end_s: Floats
    signal: Floats
    """[kcps/SPAD]; of an erasure, the last one before it."""
    valid: NDArray[np.bool_]

    def zone(self, law: NoiseLaw, rows: slice, *hidden_s: tuple[float, float]) -> Zone:
        """Return the valid samples of some rows that touch no time that is hidden."""
        noise = float(law.variance(np.array(self.signal[rows].mean())))
        begin_s, end_s = self.begin_s[rows], self.end_s[rows]
        kept = self.valid[rows].copy()
        for from_s, to_s in hidden_s:
            kept &= ~((begin_s < to_s) & (end_s > from_s))
        return Zone(
            begin_s[kept],
            end_s[kept],
            self.signal[rows][kept],
            period_s=self.period_s,
            least=LEAST_NOISE * noise,
        )


class Verdict(NamedTuple):
    """What the core decides of a hit, and the window that it has last looked at."""

    reason: int
    evidence: float
    word: float
    margin: float
    start_s: float
    bit_s: float
    brightening_s: float
    rows: slice
    sources: list[int]


class Statistics:
    """The statistics of the core, in a process that holds the frames of one recording."""

    def __init__(self, core: Core) -> None:
        """Take the process."""
        self._core = core
        self.read = int(lib.RL_REASONS)
        """What the core answers in place of a reason where there is none to refuse."""

    def ask(self, *words: object) -> list[float]:
        """Return the numbers that answer one question."""
        return [float(word) for word in self._core.ask(*words).split()]

    def take(self, recording: Recording, law: NoiseLaw, bit_s: float) -> None:
        """Forget all, and take the frames of a recording."""
        grid = recording.grid
        self.ask('begin', grid.rows, grid.columns, law.floor, law.slope, law.ambient, bit_s)
        for frame in recording:
            columns = (frame.signal, frame.distance, frame.status)
            zones = np.stack([column.astype(np.float64) for column in columns], axis=1)
            self.ask('frame', frame.stamp_ns, *zones.ravel())

    def rows(self, source: int) -> Rows:
        """Return the samples of a source."""
        period_s, *values = self.ask('held', source)
        begin_s, end_s, signal, valid = np.array(values).reshape(-1, 4).T
        return Rows(period_s, begin_s, end_s, signal, valid > 0)

    def open(self, from_s: float, to_s: float, *sources: int) -> tuple[float, slice]:
        """Open a window; return its log likelihood without a packet, and its rows."""
        return _window(self.ask('open', sources[0], from_s, to_s, *sources[1:]))

    def hide(self, from_s: float, to_s: float) -> tuple[float, slice]:
        """Leave out exposures of the window; return the same."""
        return _window(self.ask('hide', from_s, to_s))

    def attempt(self, sending: Sending) -> tuple[float, Floats]:
        """Return the log likelihood of a sending; and likelihood, gain, variance by source."""
        total, *fits = self.ask('try', *_words(sending))
        return total, np.array(fits).reshape(-1, 3)

    def decide(
        self, source: int, packets: int, to_s: float, hits: list[tuple[int, Sending]]
    ) -> Verdict:
        """Judge the first of hits of IDs, in a detector that demands nothing."""
        words: list[object] = []
        for number, hit in hits:
            words += [number, int(hit.repeats), hit.start_s, hit.bit_s]
        answer = self.ask('decide', source, packets, to_s, *words)
        reason, evidence, word, margin, start_s, bit_s, brightening_s, first, rows, *sources = (
            answer
        )
        return Verdict(
            reason=int(reason),
            evidence=evidence,
            word=word,
            margin=margin,
            start_s=start_s,
            bit_s=bit_s,
            brightening_s=brightening_s,
            rows=slice(int(first), int(first + rows)),
            sources=[int(source) for source in sources],
        )


def _window(answer: list[float]) -> tuple[float, slice]:
    """Return log likelihood and rows of a window."""
    null, first, rows = answer
    return null, slice(int(first), int(first + rows))


def _words(sending: Sending) -> list[object]:
    """Return a sending as the core reads it."""
    bits = int(''.join(str(int(bit)) for bit in sending.bits), 2)
    return [bits, int(sending.repeats), sending.start_s, sending.bit_s, sending.brightening_s]
