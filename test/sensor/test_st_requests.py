# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a reader of ST's example asks of the board, and what it says of its period."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from harness_serial import Reading
from st_board import Board, check_zones, make_zones, text_of

from retrolidar_ros.sensor.protocols import PROTOCOLS
from retrolidar_ros.sensor.st_example import (
    PATIENCE_FRAMES,
    PERIODS,
    REQUESTS,
    UNHEEDED,
    FramePeriod,
    StExampleReader,
    slow_text,
)
from retrolidar_ros.sensor.wire import WireCounts

NOW_NS = 1_700_000_000_123_456_789
WITHHELD = REQUESTS * PATIENCE_FRAMES

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
def test_the_signal_is_asked_for(steps: list[tuple[bytes | None, bytes]]) -> None:
    reader = StExampleReader(lambda: NOW_NS)
    for data, request in steps:
        if data is None:
            reader.restart()
        else:
            reader.feed(data)
        assert reader.request() == request


def test_frames_without_signal_are_withheld_until_two_requests_were_in_vain() -> None:
    reader = StExampleReader(lambda: NOW_NS)
    assert reader.feed(LIGHT)
    assert reader.feed(DARK * WITHHELD) == []
    assert UNHEEDED not in reader.notice()
    (frame,) = reader.feed(DARK)
    assert frame.sequence == 1  # what is withheld is not lost
    assert not frame.signal.any()
    assert UNHEEDED in reader.notice()
    assert len(reader.feed(DARK * 20)) == 20
    assert UNHEEDED not in reader.notice()
    assert reader.counts == WireCounts(frames=22, withheld=WITHHELD)
    assert reader.feed(LIGHT + DARK)[0].signal.any()
    assert reader.counts.withheld == WITHHELD + 1
    # So a still scene does not blink when its signal is switched on.
    frames = StExampleReader(lambda: NOW_NS).feed(DARK * 2 + LIGHT * 20)
    assert len(frames) == 20
    assert {frame.signal.tobytes() for frame in frames} == {frames[0].signal.tobytes()}


@pytest.fixture
def board() -> Iterator[Board]:
    with Board(make_zones()) as board:
        yield board


@pytest.fixture
def reading(board: Board) -> Iterator[Reading]:
    reading = Reading(Path(board.path), 460800, PROTOCOLS['st_example'](lambda: NOW_NS))
    assert reading.report() == f'reading {board.path}'
    yield reading
    reading.end()


def test_a_board_that_did_not_hear_is_asked_again(board: Board, reading: Reading) -> None:
    board.print_frame()
    assert board.heed_key(10)
    board.light = False  # the key was lost
    for _ in range(PATIENCE_FRAMES):
        board.print_frame()
    assert board.heed_key(10)
    assert board.keys == b'ss'
    board.print_frame()
    check_zones(reading.frame(), board.zones, light=True)


def notices(reader: StExampleReader, count: int) -> list[str]:
    """Let frames come; return the notices."""
    found = []
    for _ in range(count):
        assert reader.feed(text_of(make_zones(), light=True))
        if notice := reader.notice():
            found.append(notice)
        assert reader.notice() == ''
    return found


def test_a_slow_period_is_noticed_once_and_when_it_changes_much() -> None:
    now_ns = 0
    step_ns = 232_000_000

    def clock() -> int:
        nonlocal now_ns
        now_ns += step_ns
        return now_ns

    reader = StExampleReader(clock)
    assert notices(reader, PERIODS) == []
    assert notices(reader, 1) == [slow_text(0.232)]
    assert notices(reader, 50) == []
    step_ns = 260_000_000
    assert notices(reader, 50) == []
    step_ns = 400_000_000
    assert notices(reader, 50) == [slow_text(0.4)]
    reader.restart()
    assert notices(reader, PERIODS) == []
    assert notices(reader, 1) == [slow_text(0.4)]
    text = slow_text(0.2316)
    assert 'a frame every 232 ms' in text
    assert 'the 21 ms of the RetroLiDAR paper are out of reach' in text
    assert re.findall(r'bit_period to ([\d.]+\d)', text) == ['0.463']


def test_pauses_do_not_change_the_period_and_a_clock_that_stands_or_goes_back_has_none() -> None:
    period = FramePeriod()
    steps_us = [200_000] * PERIODS
    steps_us[2] = steps_us[7] = 3_000_000
    found = [period.take(int(time)) for time in np.cumsum([0, *steps_us])]
    assert found == [None] * PERIODS + [pytest.approx(0.2)]
    for step in (0, -1):
        period = FramePeriod()
        assert [period.take(5 + step * index) for index in range(3 * PERIODS)] == [
            None
        ] * 3 * PERIODS
