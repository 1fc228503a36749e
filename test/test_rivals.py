# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest
from numpy.typing import NDArray

from retrolidar_ros.code import IDS, PACKET_BITS, packet
from retrolidar_ros.detector.rivals import Rivals, Window
from retrolidar_ros.detector.words import WordBank

CUT = 2  # bits of the packet that are still to come
LEAST_LEAD = np.log(250)  # the least that any method asks of a repeating packet
SAMPLES = 2 * PACKET_BITS


@pytest.fixture(scope='module')
def rivals() -> Rivals:
    return Rivals(WordBank())


def window_of(bits: NDArray[np.uint8], first: int, *, repeats: bool) -> Window:
    """Return the window in which bits were seen without noise, two samples each."""
    deviation = bits - bits.mean()
    return Window(
        soft=2 * deviation,
        energy=float(2 * deviation @ deviation),
        phase=0.0,
        samples=SAMPLES,
        first=first,
        repeats=repeats,
        packets=1,
        presence=np.ones(PACKET_BITS),
    )


def beginning(identity: int) -> NDArray[np.uint8]:
    """Return a window that begins before a packet, while its marker sleeps, and ends within it."""
    silence = np.zeros(CUT, dtype=np.uint8)
    return np.concatenate([silence, packet(identity)[:-CUT]])


def test_the_beginning_of_a_lone_packet_is_no_other_packet_that_repeats(rivals: Rivals) -> None:
    ids = np.arange(1, IDS - 1)
    packets = packet(ids)
    shifted = np.stack([np.roll(packets, first, axis=1) for first in range(PACKET_BITS)])
    signs = (1 - 2 * shifted.reshape(-1, PACKET_BITS).astype(np.float32)).T
    near = 0
    chosen = np.random.default_rng(0).choice(ids, 400, replace=False)
    windows = np.array([beginning(identity) for identity in chosen.tolist()])
    for row, bits in enumerate(windows):
        differing = (PACKET_BITS - (1 - 2 * bits.astype(np.float32)) @ signs) / 2
        for place in np.flatnonzero(differing <= 2).tolist():
            first, column = divmod(place, len(ids))
            if ids[column] == chosen[row]:
                continue
            near += 1
            margin = rivals.margin(window_of(bits, first, repeats=True), int(ids[column]))
            assert margin is None or margin < LEAST_LEAD
    assert near >= 10


def test_the_beginning_of_a_lone_packet_is_not_its_whole_that_repeats(rivals: Rivals) -> None:
    for identity in (5, 700, 2073, 4000):
        margin = rivals.margin(window_of(beginning(identity), CUT, repeats=True), identity)
        assert margin is None or margin < LEAST_LEAD


@pytest.mark.parametrize('first', [8, 15, 23])
def test_a_packet_that_repeats_leads_clearly(rivals: Rivals, first: int) -> None:
    for identity in np.random.default_rng(1).integers(1, IDS - 1, 30).tolist():
        window = window_of(np.roll(packet(identity), first), first, repeats=True)
        margin = rivals.margin(window, identity)
        assert margin is not None
        assert margin > np.log(1e4)


def test_a_lone_packet_that_is_complete_leads_clearly(rivals: Rivals) -> None:
    for identity in np.random.default_rng(2).integers(1, IDS - 1, 30).tolist():
        margin = rivals.margin(window_of(packet(identity), 0, repeats=False), identity)
        assert margin is not None
        assert margin > np.log(1e4)


def test_a_wrong_packet_does_not_lead(rivals: Rivals) -> None:
    margin = rivals.margin(window_of(packet(700), 0, repeats=False), 701)
    assert margin is not None
    assert margin < 0
