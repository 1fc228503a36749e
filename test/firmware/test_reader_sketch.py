# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The reader's sketch, run on this machine against stand-ins for an Arduino's libraries."""

from __future__ import annotations

import re
import shutil
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from harness_firmware import ROOT, RawFrame, assert_same_zones, make, read_line, run_host

from retrolidar_ros.scene.emulator import VERSION
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.identity import KIND_IDENTITY, Identity, decode_identity
from retrolidar_ros.sensor.wire import cobs_decode

FRAME_US = 20_833


def raw_frames(count: int, zones: int = 16, seed: int = 1) -> list[RawFrame]:
    rng = np.random.default_rng(seed)
    return [
        RawFrame(
            0,
            0,
            rng.integers(0, 16_000, zones),
            rng.integers(0, 2**24, zones),
            rng.integers(0, 2**16, zones),
            rng.choice([5, 6, 9, 10, 8], zones),
        )
        for _ in range(count)
    ]


def results_of_driver(frames: Sequence[RawFrame], status: Sequence[int]) -> str:
    """Return what the reader's program reads as the results of ST's driver."""
    lines = []
    for frame, failure in zip(frames, status, strict=True):
        ones = np.ones(frame.zones, dtype=int)
        zones = np.stack([ones, frame.distance, frame.signal, frame.ambient, frame.status], axis=1)
        lines.append(' '.join(map(str, [failure, *zones.ravel()])))
    return '\n'.join(lines)


def read_by(
    program: Path,
    frames: Sequence[RawFrame],
    *,
    status: Sequence[int] | None = None,
    start_us: int = 0,
    baud: int | None = None,
    period_us: int = FRAME_US,
) -> list[Frame]:
    """Return the frames that come out of the line when a reader sees these, none changed."""
    given = results_of_driver(frames, status or [0] * len(frames))
    slow = [] if baud is None else [baud]
    found, reader = read_line(run_host(program, start_us, period_us, *slow, given=given))
    assert reader.counts.damaged == 0
    for frame in found:
        assert_same_zones(frame, frames[frame.sequence - 1])
    return found


def test_every_frame_of_the_sensor_comes_out_of_the_line(programs: Path) -> None:
    frames = read_by(programs / 'reader_host', raw_frames(500))
    assert [frame.sequence for frame in frames] == list(range(1, 501))


def test_stamps_are_of_the_middle_of_the_exposure_and_never_go_back(programs: Path) -> None:
    start_us = 2**32 - 500_000  # the counter of the timer wraps after half a second
    frames = read_by(programs / 'reader_host', raw_frames(50), start_us=start_us)
    times = np.array([frame.sensor_time_us for frame in frames])
    # The timer counts to 2^32 - 2 and not to 2^32 - 1, so it gains a microsecond when it wraps.
    assert set(np.diff(times)) == {FRAME_US, FRAME_US + 1}
    interrupts = times[0] + FRAME_US // 2
    # Between the start and the first frame, the sketch waited for the sensor's power only.
    assert 0 < interrupts - start_us - FRAME_US < 20_000


@pytest.mark.parametrize(
    ('status', 'numbers'),
    [
        ([0, 0, 2, 0, 0, 255, 2, 0, 0, 0], [1, 2, 4, 5, 8, 9, 10]),
        # What was read third is the frame that was made while the second one was read.
        ([0, 256, 0, 0, 256, 0, 0, 0, 0, 0], [1, 3, 4, 6, 7, 8, 9, 10]),
    ],
)
def test_a_frame_not_read_is_a_gap(programs: Path, status: list[int], numbers: list[int]) -> None:
    frames = read_by(programs / 'reader_host', raw_frames(10), status=status)
    assert [frame.sequence for frame in frames] == numbers


@pytest.mark.parametrize('baud', [9_600, 57_600])
def test_a_slow_line_loses_whole_frames_and_nothing_else(programs: Path, baud: int) -> None:
    frames = read_by(programs / 'reader_host', raw_frames(200), baud=baud)
    bytes_sent = 200 * FRAME_US * 1e-6 * baud / 10
    assert len(frames) * 195 > bytes_sent  # what the line can carry is carried
    assert len(frames) < 200


def test_a_sensor_that_does_not_answer_is_reported(programs: Path) -> None:
    line = run_host(programs / 'reader_host', 0, FRAME_US, NO_SENSOR='1')
    assert re.search(rb'VL53L8CX: start failed; check the jumpers', line)
    # Before the first delimiter there may be the rest of a packet, which is no damage.
    frames, reader = read_line(b'\0' + line)
    assert not frames
    assert reader.counts.damaged == 1


SERIAL = bytes(range(12))


def typed(*lines: str) -> str:
    """Return what the reader's program types to the sketch."""
    return ''.join(f'> {line}\n' for line in lines)


def identities(line: bytes) -> list[Identity]:
    """Return every identity on a line."""
    contents = [cobs_decode(packet)[:-2] for packet in line.split(b'\0')[:-1]]
    return [decode_identity(one) for one in contents if one[0] == KIND_IDENTITY]


def test_the_reader_says_who_it_is_at_the_start_and_when_asked(programs: Path) -> None:
    frames = results_of_driver(raw_frames(3), [0, 0, 0])
    no_commands = ('identif', 'identify now', '', 'starts', 'STOP', 'start' + 99 * 'x', 'sto\rp')
    given = typed(*no_commands, 'identify\r') + frames
    line = run_host(programs / 'reader_host', 0, FRAME_US, given=given)
    assert identities(line) == 2 * [Identity(VERSION, SERIAL.hex(), True)]
    seen, reader = read_line(line)
    assert len(seen) == 3
    assert (reader.counts.damaged, reader.counts.unknown_kind) == (0, 0)
    assert reader.commands.identity == Identity(VERSION, SERIAL.hex(), True)


def test_a_stopped_sensor_sends_no_frames_and_goes_on_with_the_next_number(programs: Path) -> None:
    before, unseen, after = (raw_frames(4, seed=seed) for seed in (1, 2, 3))
    parts = [results_of_driver(frames, [0] * 4) + '\n' for frames in (before, unseen, after)]
    given = parts[0] + typed('stop', 'stop') + parts[1] + typed('start', 'start') + parts[2]
    line = run_host(programs / 'reader_host', 0, FRAME_US, given=given)
    assert [one.is_ranging for one in identities(line)] == [True, False, False, True, True]
    seen, _ = read_line(line)
    assert [frame.sequence for frame in seen] == list(range(1, 9))
    for frame, raw in zip(seen, [*before, *after], strict=True):
        assert_same_zones(frame, raw)


def test_a_reset_is_answered_before_it_happens(programs: Path) -> None:
    given = typed('stop', 'reset', 'identify') + results_of_driver(raw_frames(1), [0])
    line = run_host(programs / 'reader_host', 0, FRAME_US, given=given)
    assert [one.is_ranging for one in identities(line)] == [True, False, True]
    assert read_line(line)[0] == []


def test_one_constant_makes_it_8x8_at_15_hz(programs: Path, tmp_path: Path) -> None:
    copy = tmp_path / 'package'
    for directory in ('core', 'firmware', 'test/firmware'):
        shutil.copytree(ROOT / directory, copy / directory)
    sketch = copy / 'firmware' / 'reader' / 'reader.ino'
    before = sketch.read_text()
    after = before.replace('constexpr uint8_t ROWS = 4;', 'constexpr uint8_t ROWS = 8;')
    assert after != before
    sketch.write_text(after)
    build = tmp_path / 'build'
    # As sources keep their times, only the sketch is compiled anew.
    shutil.copytree(programs, build)
    make(copy / 'firmware', build, build / 'reader_host')
    frames = read_by(build / 'reader_host', raw_frames(20, zones=64), period_us=66_667)
    assert [frame.sequence for frame in frames] == list(range(1, 21))
