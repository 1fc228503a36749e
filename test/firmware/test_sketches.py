# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sketches, run on this machine against stand-ins for an Arduino's libraries."""

import re
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from harness_firmware import ROOT, IntArray, RawFrame, assert_same_zones, make, read_line, run_host
from numpy.typing import NDArray

from retrolidar_ros.marker.code import BIT_PERIOD_S, packet
from retrolidar_ros.marker.power import (
    CELL_MAH,
    LOOK_EVERY_S,
    LOOK_S,
    PROTOTYPE,
    WAKING_S,
    active_share,
    drawn,
)
from retrolidar_ros.scene.emulator import VERSION
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.identity import KIND_IDENTITY, Identity, decode_identity
from retrolidar_ros.sensor.wire import cobs_decode

FIRST_PIN, SECOND_PIN, FRONTEND_PIN = 9, 10, 3
LISTEN_US = 5_000_000
ID = 2073
PACKETS = 2
TRAIN_US = PACKETS * round(31 * BIT_PERIOD_S * 1e6)


class Marker(NamedTuple):
    """What a run of the marker's sketch did."""

    events: IntArray
    """Time [µs], pin and level of each change, shape (changes, 3)."""
    said: str
    deep_sleep_us: int
    waited_us: int
    kept_id: int
    """In the memory that outlives a reset."""

    def high_us(self, pin: int) -> IntArray:
        """Return from when to when a pin was high, shape (times, 2)."""
        own = self.events[self.events[:, 1] == pin]
        pairs: IntArray = own[: len(own) // 2 * 2, 0].reshape(-1, 2)
        return pairs


def run_marker(
    programs: Path,
    seconds: int,
    light_from_us: int = 0,
    light_until_us: int = 0,
    typed: Sequence[str] = (),
    **environment: str,
) -> Marker:
    arguments = (seconds, light_from_us, light_until_us, *typed)
    lines = run_host(programs / 'marker_host', *arguments, **environment).decode().split('\n')
    events = [list(map(int, line.split())) for line in lines if re.match(r'\d', line)]
    deep_sleep_us, waited_us, kept_id = map(int, next(x for x in lines if x[:1] == '$')[1:].split())
    said = ''.join(line[1:] for line in lines if line[:1] == '#')
    return Marker(np.array(events).reshape(-1, 3), said, deep_sleep_us, waited_us, kept_id)


def bits_sent(marker: Marker) -> NDArray[np.bool_]:
    """Return which bits were dark, from the first dark one on, checking their voltages."""
    first, second = marker.high_us(FIRST_PIN), marker.high_us(SECOND_PIN)
    bit_us = round(BIT_PERIOD_S * 1e6)
    bits = round((second[-1, 1] - first[0, 0]) / bit_us)
    edges_us = first[0, 0] + bit_us * np.arange(bits + 1)
    # How long each electrode is high in each bit.
    one_us, other_us = (
        np.sum([np.diff(np.clip(edges_us, *span)) for span in times], axis=0)
        for times in (first, second)
    )
    np.testing.assert_array_equal(one_us, other_us)  # no direct voltage over any bit
    assert np.isin(one_us, (0, bit_us / 2)).all()
    dark: NDArray[np.bool_] = one_us > 0
    return dark


def test_a_flash_of_light_is_answered_with_packets(programs: Path) -> None:
    marker = run_marker(programs, 12, 6_000_000, 6_100_000)
    dark = bits_sent(marker)
    expected = np.tile(packet(ID), PACKETS)
    expected = expected[: np.flatnonzero(expected)[-1] + 1]
    np.testing.assert_array_equal(dark, expected)
    assert marker.waited_us == pytest.approx(TRAIN_US, abs=1000)
    # Electrodes are never both high, and rest low.
    levels = marker.events[np.isin(marker.events[:, 1], (FIRST_PIN, SECOND_PIN)), 2]
    assert set(np.cumsum(2 * levels - 1)) == {0, 1}
    assert np.sum(2 * levels - 1) == 0


@pytest.mark.parametrize('light_from_us', [6_000_000, 6_077_700])
def test_it_wakes_in_the_time_that_the_budget_has(programs: Path, light_from_us: int) -> None:
    marker = run_marker(programs, 8, light_from_us, light_from_us + 1_000_000)
    waking_us = marker.high_us(FIRST_PIN)[0, 0] - light_from_us
    # The budget's, the six samples that the light is asked for, and the timer's first period.
    assert 0 < waking_us <= WAKING_S * 1e6 + 6 * 50 + 500


def test_while_there_is_light_packets_follow_each_other(programs: Path) -> None:
    marker = run_marker(programs, 20, 6_000_000, 60_000_000)
    looks = marker.high_us(FRONTEND_PIN)[:, 0]
    looks = looks[looks > marker.high_us(FIRST_PIN)[0, 0]]
    assert len(looks) >= 4
    pauses_us = np.diff(looks) - TRAIN_US
    assert (pauses_us > 0).all()
    assert (pauses_us < 2_000).all()


def test_no_light_no_packet(programs: Path) -> None:
    marker = run_marker(programs, 20)
    assert not len(marker.high_us(FIRST_PIN))
    looks = marker.high_us(FRONTEND_PIN)
    assert len(looks) == (20_000_000 - LISTEN_US) // 100_000
    np.testing.assert_allclose(looks @ [-1, 1], LOOK_S * 1e6)
    np.testing.assert_allclose(np.diff(looks[:, 0]), LOOK_EVERY_S * 1e6)


def test_a_marker_draws_what_the_paper_says_and_lives_as_long(programs: Path) -> None:
    hour_us = 3_600_000_000
    marker = run_marker(programs, 3600 + 5, 1_800_000_000, 1_800_100_000)
    assert marker.deep_sleep_us + marker.waited_us < hour_us
    looking_us = (marker.high_us(FRONTEND_PIN) @ [-1, 1]).sum()
    assert looking_us + marker.deep_sleep_us + marker.waited_us == pytest.approx(hour_us, rel=1e-4)
    mean_ma = (
        marker.deep_sleep_us * PROTOTYPE.sleep
        + looking_us * PROTOTYPE.detection
        + marker.waited_us * PROTOTYPE.active
    ) / hour_us
    assert mean_ma == pytest.approx(drawn(active_share(PACKETS)).total, rel=0.001)
    assert CELL_MAH / mean_ma / 24 > 60  # the paper's two months


NO_IDS = ['id 0', 'id 4095', 'id', 'id ', 'ID 7', 'id 7x', 'id -7', 'help']
NO_IDS += ['id 4294967303', 'id 99999999999999999999']  # the first is 7 modulo 2^32


@pytest.mark.parametrize(
    ('typed', 'memory', 'marker_id', 'said'),
    [
        ([], {}, ID, 'marker, id 2073'),
        (['id 0007'], {}, 7, 'id 7 is kept'),
        (NO_IDS, {}, ID, 'not understood'),
        (['id 8888 and much more than the line holds', 'id 4094'], {}, 4094, 'id 4094 is kept'),
        (['id 0000000000012'], {}, ID, 'not understood'),  # its first 15 characters are a command
        ([], {'KEPT_ID': '7'}, 7, 'marker, id 7'),  # it outlives a reset
        ([], {'ERASED': '255'}, ID, 'marker, id 2073'),
        ([], {'KEPT_ID': '4095'}, ID, 'marker, id 2073'),
    ],
)
def test_its_id_is_set_over_the_serial_line_and_kept(
    programs: Path, typed: list[str], memory: dict[str, str], marker_id: int, said: str
) -> None:
    marker = run_marker(programs, 12, 6_000_000, 6_100_000, typed, **memory)
    assert said in marker.said
    if not memory:
        assert marker.kept_id == (marker_id if 'is kept' in said else 0)
    np.testing.assert_array_equal(bits_sent(marker)[:31], packet(marker_id))


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


def test_every_frame_is_sent_with_the_middle_of_its_exposure(programs: Path) -> None:
    start_us = 2**32 - 500_000  # the counter of the timer wraps after half a second
    frames = read_by(programs / 'reader_host', raw_frames(500), start_us=start_us)
    assert [frame.sequence for frame in frames] == list(range(1, 501))
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
