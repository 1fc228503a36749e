# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What firmware calls of the core in C, against the package, byte for byte."""

import re
from pathlib import Path
from struct import pack
from typing import Any

import numpy as np
import pytest
from harness_core import bind_core
from harness_firmware import (
    FIRMWARE,
    IntArray,
    RawFrame,
    assert_same_zones,
    make,
    need,
    printed,
    read_line,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from retrolidar_ros.marker.code import packet
from retrolidar_ros.marker.power import REACH_M, THRESHOLD_V, voltage_v
from retrolidar_ros.sensor.model import Status
from retrolidar_ros.sensor.wire import encode_frame, encode_packet


class Core:
    """The functions that firmware calls."""

    def __init__(self, directories: pytest.TempPathFactory) -> None:
        """Compile it."""
        self.ffi, self.lib = bind_core(directories, 'command', 'marker', 'wire')

    def encode(
        self, raw: RawFrame, capacity: int | None = None, targets: IntArray | None = None
    ) -> bytes:
        """Return a frame as the core puts it on the line."""
        if targets is None:
            targets = raw.status != Status.NO_TARGET
        columns = (targets, raw.distance, raw.signal, raw.ambient, raw.status)
        zones = [self.lib.rl_zone_of(*map(int, zone)) for zone in zip(*columns, strict=True)]
        return self.put(raw.sequence, raw.time_us, raw.rows, zones, capacity)

    def put(
        self, sequence: int, time_us: int, rows: int, zones: list[Any], capacity: int | None = None
    ) -> bytes:
        """Write a frame of any shape; what lies beyond the capacity must stay as it is."""
        held = self.ffi.new('struct rl_zone[]', zones)
        frame = self.ffi.new('struct rl_frame *', (sequence, time_us, rows, held))
        room = capacity_of(len(zones)) if capacity is None else capacity
        line = bytearray(b'\xa5' * (room + 8))
        count = self.lib.rl_wire_encode(frame, self.ffi.from_buffer('uint8_t[]', line), room)
        assert count <= room
        assert line[room:] == b'\xa5' * 8
        return bytes(line[:count])

    def driven(self, marker_id: int, packets: int, ticks: int) -> str | None:
        """Return the states of the electrodes at each tick; None if they are refused."""
        state = self.ffi.new('struct rl_drive *')
        if not self.lib.rl_drive_start(state, marker_id, packets, ticks):
            return None
        states = ''
        electrodes = self.lib.rl_drive_tick(state)
        while state.busy:
            assert not self.lib.rl_drive_start(state, marker_id, 1, 2)
            states += '0+-'[electrodes]
            electrodes = self.lib.rl_drive_tick(state)
        assert electrodes == self.lib.rl_drive_tick(state) == self.lib.RL_SHORTED
        assert not state.busy
        return states


@pytest.fixture(scope='module')
def core(tmp_path_factory: pytest.TempPathFactory) -> Core:
    return Core(tmp_path_factory)


# --- Wire


@st.composite
def raw_frames(draw: st.DrawFn) -> RawFrame:
    zones = draw(st.sampled_from([16, 64]))
    most = draw(st.sampled_from([2**24 - 1, 2**24 - 1, 2**32 - 1]))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))

    def column(least: int, most: int) -> IntArray:
        # Zeros and bytes of ones are what COBS treats differently.
        special = rng.choice([least, most, max(least, 0)], zones)
        values: IntArray = rng.integers(least, most + 1, zones)
        return np.where(rng.random(zones) < rng.choice([0.0, 0.3, 1.0]), special, values)

    status = column(0, 255)
    there = status != Status.NO_TARGET
    sequence, time_us = draw(st.integers(0, 2**32 - 1)), draw(st.integers(0, 2**64 - 1))
    distance, signal = column(-(2**15), 2**15 - 1) * there, column(0, most) * there
    return RawFrame(sequence, time_us, distance, signal, column(0, most), status)


@settings(max_examples=150)
@given(raw=raw_frames())
def test_any_frame_is_packed_as_the_wire_says_and_read_back(core: Core, raw: RawFrame) -> None:
    header = pack('<BIQBB', 1, raw.sequence, raw.time_us, raw.rows, raw.rows)
    columns = (raw.distance, raw.signal, raw.ambient, raw.status)
    zones = b''.join(pack('<hIIB', *map(int, zone)) for zone in zip(*columns, strict=True))
    line = core.encode(raw)
    assert line == encode_packet(header + zones)
    (frame,), reader = read_line(line)
    assert reader.counts.damaged == 0
    np.testing.assert_array_equal(np.isnan(frame.distance), frame.status == Status.NO_TARGET)
    assert (frame.sequence, frame.sensor_time_us) == (raw.sequence, raw.time_us)
    # A float32 of the package holds 24 bits, which is 8192 kcps/SPAD.
    if max(raw.signal.max(), raw.ambient.max()) < 2**24:
        assert_same_zones(frame, raw)
        assert encode_frame(frame) == line


def test_a_zone_without_a_target_says_so_whatever_the_driver_left_in_it(core: Core) -> None:
    zones = np.arange(16)
    raw = RawFrame(1, 1, 400 + zones, 2048 * (1 + zones), 2048 + zones, np.full(16, 5))
    (frame,), _ = read_line(core.encode(raw, targets=zones % 2))
    read = RawFrame.of(frame)
    np.testing.assert_array_equal(read.status, np.where(zones % 2, 5, Status.NO_TARGET))
    np.testing.assert_array_equal(read.signal, np.where(zones % 2, raw.signal, 0))
    np.testing.assert_array_equal(read.ambient, raw.ambient)
    assert np.isnan(frame.distance).sum() == 8


def capacity_of(zones: int) -> int:
    """Return the bytes of the longest line: header, zones, checksum, COBS and the delimiter."""
    content = 15 + 11 * zones + 2
    return content + content // 254 + 2


@pytest.mark.parametrize('zones', [16, 64])
def test_the_longest_frame_needs_all_of_the_capacity(core: Core, zones: int) -> None:
    full = np.full(zones, 2**32 - 1)  # no zero anywhere: COBS is at its longest
    raw = RawFrame(2**32 - 1, 2**64 - 1, np.full(zones, -1), full, full, np.full(zones, 254))
    capacity = capacity_of(zones)
    assert capacity - 1 <= len(core.encode(raw, capacity)) <= capacity
    assert core.encode(raw, capacity - 1) == b''
    for none in (0, 1, 3, 5, 16, 255):
        assert core.put(1, 1, none, [], 4096) == b''


@given(start=st.integers(0, 2**63), steps=st.lists(st.integers(0, 2**32 - 1), max_size=20))
def test_a_counter_that_wraps_is_extended(core: Core, start: int, steps: list[int]) -> None:
    true = extended = start
    for step in steps:
        true += step
        extended = core.lib.rl_extend_us(extended, true % 2**32)
        assert extended == true


# --- Liquid crystal


@pytest.mark.parametrize('packets', [1, 3])
@pytest.mark.parametrize('ticks', [2, 84])
def test_a_square_wave_drives_every_dark_bit(core: Core, packets: int, ticks: int) -> None:
    for marker_id in (1, 2073, 2047, 4094):
        driven = core.driven(marker_id, packets, ticks)
        assert driven is not None
        bits = ['0' * ticks, '+-' * (ticks // 2)]
        sent = [bits.index(driven[at : at + ticks]) for at in range(0, len(driven), ticks)]
        np.testing.assert_array_equal(sent, np.tile(packet(marker_id), packets))
        assert core.driven(marker_id, 0, ticks) == ''
    for odd in (0, 1, 83):
        assert core.driven(2073, 1, odd) is None


# --- Wake-up, on a photodiode's voltage in units of 10 µV and steps of 1 ms

THRESHOLD = round(THRESHOLD_V * 1e5)


SENT = -1


def woken(core: Core, *levels: int, threshold: int = THRESHOLD, hysteresis: int = 50) -> str:
    """Return the modes of a marker that sleeps for 99 ms and looks for one, a letter each."""
    state = core.ffi.new('struct rl_wakeup *')
    settings = core.ffi.new('struct rl_wakeup_settings *', (99_000, 1_000, threshold, hysteresis))
    core.lib.rl_wakeup_start(state, settings)
    modes = (
        core.lib.rl_wakeup_sent(state)
        if level == SENT
        else core.lib.rl_wakeup_step(state, 1000, level)
        for level in levels
    )
    return ''.join('sdt'[mode] for mode in modes)


@pytest.mark.parametrize(('range_m', 'wakes'), [(0.5, True), (2.2, True), (2.3, False)])
def test_it_wakes_where_the_paper_says(core: Core, range_m: float, wakes: bool) -> None:
    assert 2.2 < REACH_M < 2.3
    level = round(float(voltage_v(np.array(range_m))) * 1e5)
    assert ('t' in woken(core, *[level] * 250)) == wakes


def test_hysteresis_keeps_a_marker_awake_that_has_sent(core: Core) -> None:
    below, far_below = THRESHOLD - 10, THRESHOLD - 60
    # It does not wake at a level at which, awake, it goes on.
    assert woken(core, below) == 's'
    assert woken(core, THRESHOLD, SENT, below, SENT, below) == 'tdtdt'
    # Below the hysteresis it sleeps, and then the full threshold is needed again.
    slept = woken(core, THRESHOLD, SENT, far_below, *[below] * 101)
    assert slept == 'tds' + 's' * 98 + 'd' + 's' * 2
    # A hysteresis above the threshold keeps nothing awake in the dark.
    assert woken(core, 5, SENT, 0, threshold=5, hysteresis=9) == 'tds'


# --- Size


MAX_RAM = {'marker_m0': 256, 'marker_m4': 256, 'reader_m4': 2560}
"""Of each image, with its stack [B]."""


def test_the_core_fits_small_processors(tmp_path: Path) -> None:
    need('make', 'arm-none-eabi-gcc')
    size = r'^\s*(\d+)\s+(\d+)\s+(\d+)\s+\d+\s+\w+\s+\S*?(\w+)\.elf$'
    rows = re.findall(size, make(FIRMWARE, tmp_path, 'size'), re.M)
    assert {row[-1] for row in rows} == set(MAX_RAM)
    for text, data, bss, name in rows:
        listed = printed('arm-none-eabi-nm', '--format=posix', tmp_path / f'{name}.elf')
        symbols = {line.split()[0] for line in listed.splitlines()}
        used = ''.join(usage.read_text() for usage in tmp_path.glob(f'{name}.elf-*.su'))
        frames = [row.split('\t') for row in used.splitlines()]
        stack = sum(int(size) for where, size, _ in frames if where.split(':')[-1] in symbols)
        assert int(text) + int(data) < 4096, name
        # Nothing calls itself, so the frames of all functions are more than the stack ever holds.
        assert int(data) + int(bss) + stack < MAX_RAM[name], name
        # Arithmetic of floating point, which libgcc would bring, and a heap.
        assert not any(re.match(r'__aeabi_[fd]|malloc|free', one) for one in symbols), name
