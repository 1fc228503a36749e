# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The text of ST's example is read as it is printed, whatever stands between its frames."""

import pickle
import random
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from st_board import Board, Reading, Zone, check_zones, make_zones, text_of

from retrolidar_ros.sensor.frame import Frame, ZoneGrid
from retrolidar_ros.sensor.serial_source import PROTOCOLS
from retrolidar_ros.sensor.st_example import MAX_LINE_BYTES, PATIENCE_FRAMES, StExampleReader
from retrolidar_ros.sensor.wire import WireCounts

NOW_NS = 1_700_000_000_123_456_789
both_sides = pytest.mark.parametrize('side', [4, 8])


def new_reader() -> StExampleReader:
    return StExampleReader(lambda: NOW_NS)


def read(text: bytes) -> tuple[list[Frame], WireCounts]:
    reader = new_reader()
    return reader.feed(text), reader.counts


@both_sides
@pytest.mark.parametrize('line_end', ['\n', '\r\n'])
def test_what_is_printed_is_read_with_the_end_of_its_last_row(side: int, line_end: str) -> None:
    zones, reader = make_zones(side), new_reader()
    text = text_of(zones, line_end=line_end)
    end = text.rindex(b'|' + line_end.encode()) + 1 + len(line_end)
    assert reader.feed(text[: end - 1]) == []
    (frame,) = reader.feed(text[end - 1 : end])
    assert reader.feed(text[end:]) == []
    assert reader.counts == WireCounts(frames=1)
    assert frame.grid == ZoneGrid(side, side)
    assert (frame.stamp_ns, frame.sensor_time_us) == (NOW_NS // 1000 * 1000, NOW_NS // 1000)
    for array in (frame.distance, frame.signal, frame.ambient):
        assert array.dtype == np.float32
    assert frame.status.dtype == np.uint8
    check_zones(frame, zones)


def test_statuses_negative_distances_and_one_of_two_lights() -> None:
    statuses = {5: 5, 9: 5, 0: 0, 255: 0, 1: 1, 6: 6, 10: 10, 13: 13, 254: 254}
    for printed, expected in statuses.items():
        (frame,), counts = read(text_of([Zone(-12, printed)] * 16))
        assert counts == WireCounts(frames=1)
        assert set(frame.status) == {expected}
        np.testing.assert_array_equal(frame.distance, np.full(16, -0.012, dtype=np.float32))
    (frame,), counts = read(text_of([Zone(700)] * 16).replace(LIGHT_CELL, b'|     X  :      3 '))
    assert counts == WireCounts(frames=1)
    assert (set(frame.signal), set(frame.ambient)) == ({0}, {3})


def test_it_does_not_matter_where_a_stream_is_cut() -> None:
    first, second = make_zones(4, 1), make_zones(4, 2)
    text = text_of(first) + b'\x1b[2J' + text_of(second)
    pieces = [[text[:cut], text[cut:]] for cut in range(0, len(text) + 1, 7)]
    for parts in [*pieces, [bytes([byte]) for byte in text]]:
        reader = new_reader()
        frames = [frame for part in parts for frame in reader.feed(part)]
        assert [frame.sequence for frame in frames] == [0, 1]
        assert reader.counts.frames == 2
        check_zones(frames[0], first)
        check_zones(frames[1], second)


@both_sides
def test_a_stream_may_begin_anywhere(side: int) -> None:
    text = text_of(make_zones(side))
    title_end = text.index(b'Cell Format')
    for start in range(1, len(text), {4: 7, 8: 31}[side]):
        frames, counts = read(text[start:] + text)
        assert len(frames) == (2 if start <= title_end else 1), start
        assert counts == WireCounts(frames=len(frames))  # what was never begun is no damage


def test_a_lost_line_never_makes_another_frame() -> None:
    zones = [*make_zones()[:8], *[None] * 8]
    text = text_of(zones)
    lines = text.splitlines(keepends=True)
    for lost in range(len(lines)):
        reader = new_reader()
        frames = reader.feed(b''.join(lines[:lost] + lines[lost + 1 :]) + text)
        assert 1 <= len(frames) <= 2
        for frame in frames:
            check_zones(frame, zones)
        assert len(frames) + reader.counts.damaged == 2


LIGHT_CELL = b'|   100  :      3 '
RANGING_CELL = b'| \x1b[38;5;10m  700\x1b[0m  :      0 '


@pytest.mark.parametrize(
    ('field', 'old', 'new'),
    [
        *(('bad_shape', RANGING_CELL, RANGING_CELL * times) for times in (0, 2)),
        *(('bad_shape', RANGING_CELL * 4, RANGING_CELL * times) for times in (8, 1)),
        ('bad_shape', RANGING_CELL * 4, LIGHT_CELL * 4),
        ('bad_shape', LIGHT_CELL * 4, RANGING_CELL * 4),
        ('bad_shape', LIGHT_CELL * 4, LIGHT_CELL * 8),
        *(
            ('bad_shape', b'  700', distance)
            for distance in (b'7 00 ', b'  7-0', b'nan  ', b'     ', b'32769', b'9' * 100)
        ),
        *(('bad_shape', b':      0 ', status) for status in (b':    256 ', b':     -1 ')),
        *(('bad_shape', b'  100  :', signal) for signal in (b' -100  :', b'  1e9  :')),
        *(('bad_framing', b'  700', distance) for distance in (b'  7\xf00', b'  7\x000')),
        ('overlong', b'  700', b' ' * MAX_LINE_BYTES),
    ],
)
def test_a_damaged_line_costs_its_frame_only(field: str, old: bytes, new: bytes) -> None:
    text = text_of([Zone(700)] * 16)
    assert old in text
    reader = new_reader()
    assert reader.feed(text.replace(old, new, 1)) == []
    (frame,) = reader.feed(text)
    check_zones(frame, [Zone(700)] * 16)
    assert reader.counts == WireCounts(frames=1, **{field: 1})


PIECES = [*(bytes([byte]) for byte in b'\n\r|\0'), RANGING_CELL, LIGHT_CELL]
PIECES += [b'\x1b[2H', b'\x1b[2J', b'Cell Format :', b'Signal [kcps/spad]', b'|   |   |   |   |\n']
PIECES += [b'|     X  :      X ' * 4 + b'|\n']
WHOLE = text_of(make_zones())
GARBAGE = st.one_of(
    st.binary(max_size=700),
    st.lists(st.sampled_from(PIECES), max_size=30).map(b''.join),
    st.tuples(st.integers(0, 1500), st.binary(max_size=60), st.integers(0, 60)).map(
        lambda damage: WHOLE[: damage[0]] + damage[1] + WHOLE[damage[0] + damage[2] :]
    ),
)


@given(garbage=st.lists(GARBAGE, min_size=1, max_size=4))
@example(garbage=[b'x' * (MAX_LINE_BYTES + 1)])
@example(garbage=[b'\x1b[2HCell Format :\n|   |\n'])
def test_what_follows_garbage_is_read(garbage: list[bytes]) -> None:
    reader = new_reader()
    zones = [make_zones(4, seed) for seed in range(len(garbage))]
    found = 0
    for piece, expected in zip(garbage, zones, strict=True):
        frames = reader.feed(piece + text_of(expected))
        assert frames
        check_zones(frames[-1], expected)
        found += len(frames)
    assert reader.counts.frames == found


def test_memory_is_bounded() -> None:
    reader = StExampleReader(int)
    rng = random.Random(1)
    full = text_of(make_zones(8))
    endless = [
        b'x' * 1000,
        b'|' * 1000,
        b'Cell Format :\n' * 100,
        b'|  |\n' * 300,
        b'\x1b[2HCell Format :\n' + full[full.index(b' ---') : -300],
    ]
    for _ in range(300):
        reader.feed(rng.choice(endless))
        reader.feed(rng.randbytes(1000))
        assert len(pickle.dumps(reader)) < 10_000
    assert reader.counts.overlong > 0
    assert len(reader.feed(full)) == 1


DARK, LIGHT = (text_of(make_zones(), light) for light in (False, True))
ONCE = [(DARK[:300], b''), (DARK[300:], b's'), *[(DARK, b'')] * (PATIENCE_FRAMES - 1)]


@pytest.mark.parametrize(
    'steps',
    [
        pytest.param([(b'', b''), *ONCE, *ONCE, (DARK, b's')], id='again if it does not come'),
        pytest.param([*[(LIGHT, b'')] * 20, (DARK, b's')], id='somebody else has pressed the key'),
        pytest.param([(DARK.replace(b'X', b'Y'), b''), (DARK, b's')], id='not of a damaged frame'),
        pytest.param([(DARK + LIGHT, b''), (LIGHT + DARK, b's')], id='not if it comes meanwhile'),
        pytest.param(
            [(DARK + DARK, b's'), (DARK[:700], b''), (None, b''), (DARK[700:], b''), (DARK, b's')],
            id='at the first frame of a port that was opened anew',
        ),
    ],
)
def test_the_signal_is_requested(steps: list[tuple[bytes | None, bytes]]) -> None:
    reader = new_reader()
    for data, request in steps:
        if data is None:
            reader.restart()
        else:
            reader.feed(data)
        assert reader.request() == request


def test_frames_without_signal_are_withheld_and_not_lost() -> None:
    reader = new_reader()
    frames = reader.feed(LIGHT + 20 * DARK + LIGHT)
    assert [frame.sequence for frame in frames] == [0, 1]
    assert reader.counts == WireCounts(frames=2, withheld=20)


def test_a_board_that_did_not_hear_is_asked_again() -> None:
    with Board(make_zones()) as board:
        reading = Reading(Path(board.path), 460800, PROTOCOLS['st_example'](lambda: NOW_NS))
        assert reading.report() == f'reading {board.path}'
        board.print_frame()
        assert board.heed_key(10)
        board.light = False  # the key was lost
        for _ in range(PATIENCE_FRAMES):
            board.print_frame()
        assert board.heed_key(10)
        assert board.keys == b'ss'
        board.print_frame()
        check_zones(reading.frame(), board.zones)
        reading.end()
