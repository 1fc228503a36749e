# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core compiled for this machine: its programs, and all its functions as Python sees them."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from harness_firmware import ROOT, make, need, shared_build
from harness_frames import recording_of
from numpy.typing import ArrayLike, NDArray
from oracle import Sending, Zone, light, log_likelihood

from retrolidar_ros.core import ffi as core_ffi
from retrolidar_ros.detector.likelihood_detector import core_sensor
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, NoiseLaw

SOURCES = ROOT / 'core' / 'src'
PROGRAMS = ROOT / 'test' / 'core'
LAW = NoiseLaw()
GRID = ZoneGrid()
PERIOD_S = 0.021
KEPT = 1100
TYPES = {'double': 'f8', 'float': 'f4', 'uint8_t': 'u1', 'uint16_t': 'u2'}
ONE_ZONE: Floats = np.eye(GRID.zones)[0]


def sent(
    number: int, start_s: float, *, repeats: bool = False, bit_s: float = BIT_PERIOD_S
) -> Sending:
    """Return the packet of an ID, by default a lone one."""
    return Sending(packet(number).astype(np.float64), repeats, start_s, bit_s)


def light_at(middle_s: Floats, sending: Sending) -> Floats:
    """Return the light of exposures with these middles [s]."""
    return light(sending, middle_s - PERIOD_S / 2, middle_s + PERIOD_S / 2)


def noisy(
    middle_s: Floats, mean: Floats, rng: np.random.Generator, distance: ArrayLike = 1.0
) -> Recording:
    """Return frames of a mean signal, of shape (frames, 16), with noise as the law has it."""
    signal = mean + np.sqrt(LAW.variance(mean)) * rng.standard_normal(mean.shape)
    return recording_of(middle_s, np.maximum(signal, 0), distance)


def constant(name: str) -> float:
    """Return a number of the core by its name."""
    every = ''.join(path.read_text(encoding='utf-8') for path in sorted(SOURCES.glob('*.[ch]')))
    (value,) = re.findall(rf'^static const (?:double|float) {name} = ([^;]*?)f?;', every, re.M)
    return float(value)


def compile_core(target: str, directories: pytest.TempPathFactory) -> Path:
    """Make something of the core; return its path, or fail with what the compiler said."""
    need('make', 'cc')
    build = shared_build(directories, 'core')
    make(PROGRAMS, build, build / target)
    return build / target


def declarations(header: str, known: set[str]) -> str:
    """Return what a header and those that it includes declare, but for what is known."""
    if header in known:
        return ''
    known.add(header)
    text = (SOURCES / header).read_text(encoding='utf-8')
    for unwanted in (r'/\*.*?\*/', r'^#ifdef __cplusplus.*?^#endif', r'^static inline .*?^}'):
        text = re.sub(unwanted, '', text, flags=re.S | re.M)
    text = re.sub(r'^static const .*?;', '', text, flags=re.S | re.M)
    return re.sub(
        r'^#include "(.*)"$|^#.*$',
        lambda line: declarations(line[1], known) if line[1] else '',
        text,
        flags=re.M,
    )


def bind_core(directories: pytest.TempPathFactory, *headers: str) -> tuple[Any, Any]:
    """Return all that headers declare: memory for it, and the functions."""
    ffi: Any = pytest.importorskip('cffi').FFI()
    known: set[str] = set()
    for name in headers:
        ffi.cdef(declarations(f'retrolidar_{name}.h', known))
    return ffi, ffi.dlopen(str(compile_core('core.so', directories)))


class Rows(NamedTuple):
    """What the core holds of a source, each field of shape (rows,)."""

    period_s: float
    begin_s: Floats
    end_s: Floats
    signal: Floats
    """[kcps/SPAD]; of an erasure, the last one before it."""
    valid: NDArray[np.bool_]

    def zone(self, law: NoiseLaw, rows: slice) -> Zone:
        """Return the valid samples of some rows."""
        noise = float(law.variance(np.array(self.signal[rows].mean())))
        kept = self.valid[rows]
        return Zone(
            self.begin_s[rows][kept],
            self.end_s[rows][kept],
            self.signal[rows][kept],
            period_s=self.period_s,
            least=constant('MIN_NOISE') * noise,
        )


class Statistics:
    """The statistics of the core, which hold the frames of one recording."""

    def __init__(self, directories: pytest.TempPathFactory) -> None:
        """Compile it."""
        self.ffi, self.lib = bind_core(directories, 'decide')
        self.samples = self.ffi.new('struct rl_samples *')
        self.window = self.ffi.new('struct rl_window *')
        self.codebook = self.ffi.new('struct rl_codebook *')

    def array(self, values: Any, kind: str = 'double') -> Any:
        """Return values for C."""
        return self.ffi.from_buffer(f'{kind}[]', np.ascontiguousarray(values, TYPES[kind]))

    def numpy(self, values: Any, count: int, kind: str = 'double') -> NDArray[Any]:
        """Return a copy of values of C."""
        values = self.ffi.buffer(values, count * self.ffi.sizeof(kind))
        held: NDArray[Any] = np.frombuffer(values, TYPES[kind])
        return held.copy()

    def take(self, recording: Recording, law: NoiseLaw, bit_s: float) -> None:
        """Forget all, and take the frames of a recording."""
        lib, ffi, grid = self.lib, self.ffi, recording.grid

        sensor = ffi.new('struct rl_sensor *')
        model = core_sensor(replace(VL53L8CX, noise=law), grid)
        ffi.memmove(sensor, core_ffi.buffer(model), ffi.sizeof('struct rl_sensor'))
        memory = ffi.new('struct rl_memory *')
        for counted in (True, False):
            lib.rl_samples_start(self.samples, sensor, KEPT, bit_s, memory)
            lib.rl_window_start(self.window, self.samples, memory)
            if counted:
                self._block = memory.block = ffi.new('char[]', memory.taken)
                memory.taken = 0
        self.window.min_bit_s, self.window.max_bit_s = 0.965 * bit_s, 1.035 * bit_s
        lib.rl_samples_clear(self.samples, int(recording.stamp_ns[0]))
        ambient = self.array(np.zeros(grid.zones), 'float')
        for frame in recording:
            signal, distance = (self.array(one, 'float') for one in (frame.signal, frame.distance))
            status = self.array(frame.status, 'uint8_t')
            lib.rl_samples_push(self.samples, frame.stamp_ns, signal, distance, ambient, status)

    def rows(self, source: int) -> Rows:
        """Return the samples of a source."""
        held, count = self.samples, self.samples.count
        first = source * held.capacity
        return Rows(
            held.period_s,
            self.numpy(held.begin_s, count),
            self.numpy(held.end_s, count),
            self.numpy(held.signal + first, count, 'float').astype(np.float64),
            self.numpy(held.valid + first, count, 'uint8_t') > 0,
        )

    def column(self, source: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """Return signal and validity of the target in question."""
        count, room = self.samples.count, self.ffi.addressof(self.window, 'room')
        seen = self.lib.rl_target_column(self.samples, source, 0, count, False, room)
        return self.numpy(seen.signal, count, 'float'), self.numpy(seen.valid, count, 'uint8_t') > 0

    def open(self, from_s: float, to_s: float, source: int) -> tuple[float, slice]:
        """Open a window; return its log likelihood without a packet, and its rows."""
        self.lib.rl_window_open(self.window, source, False, from_s, to_s)
        return self.window.whitened.null, self.opened()

    def opened(self) -> slice:
        """Return the rows of the window."""
        return slice(self.window.first, self.window.first + self.window.rows)

    def given(self, sending: Sending) -> Any:
        """Return what is sent for C."""
        bits = int(''.join(str(int(bit)) for bit in sending.bits), 2)
        return self.ffi.new('struct rl_transmission *', (bits, *sending[1:]))

    def attempt(self, sending: Sending) -> Any:
        """Return the fit of a sending."""
        self.lib.rl_window_try(self.window, self.given(sending))
        return self.window.fit

    def decide(
        self,
        source: int,
        packets: int,
        to_s: float,
        hits: list[tuple[int, Sending]],
        least: float = 1e-3,
        wandering: float = 0.0,
    ) -> Any:
        """Judge the first of hits of IDs, in a detector that demands little evidence only.

        `wandering` is what it demands besides where the level wanders.
        """
        thresholds = self.ffi.new('struct rl_thresholds *')
        thresholds.evidence, thresholds.word, thresholds.margin = least, 1e6, -1e6
        thresholds.wandering = wandering
        given = self.ffi.new('struct rl_hits *')
        given.count = len(hits)
        for hit, (number, sending) in zip(given.hit[0 : len(hits)], hits, strict=True):
            hit.id, hit.transmission = int(number), self.given(sending)[0]
        first = given.hit[0]
        judged = self.case({'channel': source, 'packets': packets, 'id': first.id})
        judged.verdict.transmission = first.transmission
        judged.thresholds, judged.hits, judged.to_s = thresholds, given, to_s
        judged.read_until_s = judged.since_s = -np.inf
        return self.lib.rl_decide(judged)

    def case(self, verdict: dict[str, Any]) -> Any:
        """Return a packet that is judged in the window."""
        known = {'window': self.window, 'codebook': self.codebook, 'verdict': verdict}
        return self.ffi.new('struct rl_case *', known)

    def margins(self, sending: Sending, number: int) -> tuple[Any, float, float]:
        """Return bits of a packet in the window, and its margins against sequences and parts."""
        lib, given = self.lib, self.given(sending)
        judged = self.case({'packets': 1, 'id': number, 'transmission': given[0]})
        judged.log_likelihood = self.attempt(sending).log_likelihood
        begin_s = self.samples.begin_s[self.window.first]
        begin = round((begin_s - sending.start_s) / sending.bit_s) % PACKET_BITS
        judged.bits = lib.rl_bits_cut(given, begin, 0)
        lib.rl_word_flip_bits(judged, 1e3)
        successive = lib.rl_rivals_successive_margin(judged)
        bits = self.ffi.new('struct rl_bits *', judged.bits)
        return bits, successive, lib.rl_rivals_part_margin(judged)

    def other_clock(self, sending: Sending, packets: int) -> float:
        """Return by how much bits of another clock, or another period, are likelier."""
        given, own = self.given(sending), self.attempt(sending).log_likelihood
        if packets > 1:
            return float(self.lib.rl_clock_period_excess(self.window, given))
        return float(self.lib.rl_clock_excess(self.window, given, own))

    def start_codebook(self, ids: Any = ()) -> int:
        """Let these IDs come, or all; return how many may."""
        self.lib.rl_codebook_start(self.codebook, self.array(ids, 'uint16_t'), len(ids))
        return int(self.codebook.words)


NATS = 1e-3
"""By how much core and oracle may differ."""


def assert_agrees(core: Statistics, zone: Zone, null: float, tried: list[Sending]) -> None:
    """Compare what both make of sendings in the window that the core has open."""
    assert null == pytest.approx(log_likelihood([zone], None), abs=NATS)
    for sending in tried:
        found, wanted = core.attempt(sending), zone.fit(sending)
        assert found.log_likelihood == pytest.approx(wanted.log_likelihood, abs=NATS)
        if wanted.gain > 0:
            assert found.gain == pytest.approx(wanted.gain, rel=1e-4)
        else:
            assert found.gain == 0


def around(sending: Sending, rng: np.random.Generator) -> list[Sending]:
    """Return a sending, and some that are like it or not."""
    other = sent(rng.choice(USABLE_IDS), sending.start_s, repeats=sending.repeats)
    return [
        sending,
        sending._replace(start_s=sending.start_s + rng.uniform(-0.5, 0.5) * BIT_PERIOD_S),
        other,
        sending._replace(bits=1 - sending.bits),
        sending._replace(repeats=not sending.repeats),
    ]
