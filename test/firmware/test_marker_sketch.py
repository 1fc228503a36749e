# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The marker's sketch, run on this machine against stand-ins for an Arduino's libraries."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from harness_firmware import IntArray, run_host

from retrolidar_ros.marker.battery import CELL_MAH, PROTOTYPE, active_share, drawn, life_h
from retrolidar_ros.marker.code import BIT_PERIOD_S, packet
from retrolidar_ros.marker.wakeup import LOOK_EVERY_S, LOOK_S, WAKING_S

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


def bits_sent(marker: Marker) -> IntArray:
    """Return which bits were dark, from the first dark one on, checking their voltages."""
    first, second = marker.high_us(FIRST_PIN), marker.high_us(SECOND_PIN)
    start_us = first[0, 0]
    bit_us = round(BIT_PERIOD_S * 1e6)
    bits = round((second[-1, 1] - start_us) / bit_us)
    dark = np.zeros(bits, dtype=np.uint8)
    for bit in range(bits):
        inside = [
            (np.clip(times, start_us + bit * bit_us, start_us + (bit + 1) * bit_us) @ [-1, 1]).sum()
            for times in (first, second)
        ]
        assert inside[0] == inside[1]  # no direct voltage over any bit
        assert inside[0] in (0, bit_us / 2)
        dark[bit] = inside[0] > 0
    return dark


def test_a_flash_of_light_is_answered_with_packets(programs: Path) -> None:
    marker = run_marker(programs, 12, 6_000_000, 6_100_000)
    dark = bits_sent(marker)
    expected = np.tile(packet(ID), PACKETS)
    expected = expected[: np.flatnonzero(expected)[-1] + 1]
    np.testing.assert_array_equal(dark, expected)
    assert marker.waited_us == pytest.approx(TRAIN_US, abs=1000)
    # Electrodes are never both high, and rest low.
    levels = {FIRST_PIN: 0, SECOND_PIN: 0}
    for _, pin, level in marker.events[np.isin(marker.events[:, 1], list(levels))]:
        levels[int(pin)] = int(level)
        assert sum(levels.values()) < 2
    assert not any(levels.values())


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
    assert mean_ma == pytest.approx(drawn(active_share(1, PACKETS)).total, rel=0.001)
    assert life_h(CELL_MAH, mean_ma) / 24 > 60  # the paper's two months


NO_IDS = ['id 0', 'id 4095', 'id', 'id ', 'ID 7', 'id 7x', 'id -7', 'help']
NO_IDS += ['id 4294967303', 'id 99999999999999999999']  # the first is 7 modulo 2^32


@pytest.mark.parametrize(
    ('typed', 'memory', 'marker_id', 'said'),
    [
        ([], {}, ID, 'marker, id 2073'),
        (['id 7'], {}, 7, 'id 7 is kept'),
        (NO_IDS, {}, ID, 'not understood'),
        (['id 8888 and much more than the line holds', 'id 9'], {}, 9, 'id 9 is kept'),
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
