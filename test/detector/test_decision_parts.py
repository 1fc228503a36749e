# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What single terms of the decision do, of which no other test would miss the loss."""

from collections import Counter
from typing import Any, NamedTuple

import numpy as np
import pytest
from harness_core import GRID, LAW, ONE_ZONE, PERIOD_S, Statistics, constant, light_at, noisy, sent
from harness_frames import recording_of

from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, PACKET_S, PREAMBLE, packet
from retrolidar_ros.sensor.frame import Floats

START_S = 1.0
HIT_S = START_S - PERIOD_S / 2
"""The same for the core, whose times count from the middle of the first exposure."""


class Marker(NamedTuple):
    """A marker before a wall, of which so many packets are judged."""

    id: int
    packets: int = 1
    gain: float = 60.0
    walk: float = 0.0
    """Steps of the wall's signal from frame to frame [kcps/SPAD]."""


def price(core: Statistics, marker: Marker, wandering: float = 0.0) -> float:
    """Return how much evidence a packet needs beyond what is demanded [nats]."""
    sending = sent(marker.id, START_S, repeats=marker.packets > 1)
    middle_s = np.arange(PERIOD_S / 2, START_S + (marker.packets + 0.2) * PACKET_S, PERIOD_S)
    rng = np.random.default_rng(60)
    wall = 100.0 + np.cumsum(marker.walk * rng.standard_normal(len(middle_s)))
    seen = light_at(middle_s, sending)
    mean = wall[:, None] + marker.gain * np.outer(seen, ONE_ZONE)
    core.take(noisy(middle_s, mean, rng), LAW, BIT_PERIOD_S)
    hits = [(marker.id, sending._replace(start_s=HIT_S))]
    to_s = HIT_S + marker.packets * PACKET_S + 0.02

    def judged(demanded: float) -> tuple[int, float]:
        verdict = core.decide(0, marker.packets, to_s, hits, demanded, wandering)
        return verdict.reason, verdict.evidence

    reason, evidence = judged(1e-3)
    assert reason == core.lib.RL_READ
    enough, too_much = 1e-3, 1.5 * evidence
    while too_much - enough > 0.01:
        middle = (enough + too_much) / 2
        reason, evidence = judged(middle)
        if reason == core.lib.RL_READ:
            enough = middle
        else:
            assert reason == core.lib.RL_EVIDENCE
            too_much = middle
    return float(judged(too_much)[1] - too_much)


def test_packets_that_are_combined_need_the_evidence_of_a_gain_more(core: Statistics) -> None:
    core.start_codebook()
    single, combined = (price(core, Marker(2073, packets)) for packets in (1, 2))
    assert single == pytest.approx(0.0, abs=0.1)
    assert combined == pytest.approx(constant('RL_COST_OF_GAIN'), abs=0.1)


def test_a_packet_of_few_changes_needs_more_evidence(core: Statistics) -> None:
    core.start_codebook()
    changes = {one: np.count_nonzero(np.diff(packet(one))) for one in (2073, 1)}
    assert changes[1] < changes[2073]
    assert price(core, Marker(1)) > price(core, Marker(2073)) + 5.0


def test_a_packet_needs_more_evidence_where_the_level_wanders(core: Statistics) -> None:
    core.start_codebook()
    for walk, asked in ((0.0, 0.0), (10.0, 12.0)):
        marker = Marker(2073, walk=walk)
        assert price(core, marker, 12.0) - price(core, marker) == pytest.approx(asked, abs=0.1)


@pytest.mark.parametrize('rate', [0.95, 1.05])
def test_a_clock_is_never_refined_beyond_those_looked_for(core: Statistics, rate: float) -> None:
    core.start_codebook()
    sending = sent(2073, START_S, bit_s=rate * BIT_PERIOD_S)
    mean = 10.0 + 150.0 * np.outer(light_at(MIDDLE_S, sending), ONE_ZONE)
    core.take(recording_of(MIDDLE_S, mean), LAW, BIT_PERIOD_S)
    window = core.window
    near_s = 0.999 * window.max_bit_s if rate > 1 else 1.001 * window.min_bit_s
    hit = sending._replace(start_s=HIT_S, bit_s=near_s)
    verdict = core.decide(0, 1, HIT_S + PACKET_BITS * near_s + 0.02, [(2073, hit)])
    bit_s = verdict.transmission.bit_s
    assert window.min_bit_s / 1.0001 < bit_s < 1.0001 * window.max_bit_s


WORD_NATS = 8.0
"""By how much bits of no word may be likelier, as shipped."""
MIDDLE_S = np.arange(PERIOD_S / 2, START_S + 2.2 * PACKET_S, PERIOD_S)


def judged(core: Statistics, seen: Floats, number: int, *, packets: int = 1) -> Any:
    """Return the verdict on a packet that begins at `START_S`, of light at `MIDDLE_S`."""
    mean = 10.0 + 300.0 * np.outer(seen, ONE_ZONE)
    core.take(noisy(MIDDLE_S, mean, np.random.default_rng(61)), LAW, BIT_PERIOD_S)
    core.start_codebook()
    hit = sent(number, HIT_S, repeats=packets > 1)
    return core.decide(0, packets, HIT_S + packets * PACKET_S + 0.02, [(number, hit)])


def shown(number: int, first_bit: int = 0, *, repeats: bool = False) -> Floats:
    """Return the light of a packet that begins some bits after `START_S`."""
    sending = sent(number, START_S + first_bit * BIT_PERIOD_S, repeats=repeats)
    return light_at(MIDDLE_S, sending)


def fading() -> Floats:
    """Return the gain of a marker that leaves the zone during the packet at `START_S`."""
    return np.clip(1 - (MIDDLE_S - START_S) / PACKET_S, 0, 1)


# The packet of 1958 is the last two bits of 300, and then that of 3738 but for some at its end.


def test_two_packets_of_other_ids_may_be_one(core: Statistics) -> None:
    both = shown(300, 2 - PACKET_BITS) + shown(3738, 2) - 1
    # No other single packet is nearly as likely.
    assert judged(core, both * fading(), 1958).margin < 0


def test_a_marker_that_repeats_and_leaves_is_no_other_that_does_not(core: Statistics) -> None:
    """The packet of 1476 is the last four bits of 3140, its next packet, and darkness."""
    gone_bits = 9.5
    is_there = START_S + (PACKET_BITS - gone_bits) * BIT_PERIOD_S > MIDDLE_S
    assert judged(core, shown(3140, 4, repeats=True) * is_there, 1476).margin < 10.0


def test_a_packet_of_a_marker_that_leaves_is_a_word(core: Statistics) -> None:
    verdict = judged(core, shown(2073) * fading(), 2073)
    assert verdict.word < WORD_NATS
    assert verdict.margin > 0


BESIDE = light_at(MIDDLE_S, sent(1234, 0.3, repeats=True))
"""The light of another marker."""
SPREAD = np.eye(GRID.zones)


def read_in(mean: Floats, seed: int, middle_s: Floats = MIDDLE_S) -> set[int]:
    """Return what is read in a recording."""
    frames = noisy(middle_s, mean, np.random.default_rng(seed))
    return {one.id for one in create_detector('joint', GRID).update_all(frames)}


def times_found(number: int, mean: Floats, times: int) -> int:
    """Return in how many of some recordings an ID is read."""
    return sum(number in read_in(mean, seed) for seed in range(times))


def test_a_faint_packet_of_four_zones_is_found_beside_a_bright_marker() -> None:
    """In none of them alone is it found."""
    seen = 100.0 * BESIDE + 12.0 * shown(2073, PACKET_BITS - 3)
    mean = 10.0 + np.outer(seen, np.isin(np.arange(GRID.zones), (5, 6, 9, 10)))
    assert times_found(2073, mean, 8) >= 3


def test_a_packet_that_a_marker_in_the_next_zone_hid_is_found_once_that_is_known() -> None:
    hidden = shown(2073, -round(0.3 / BIT_PERIOD_S))
    mean = 10.0 + np.outer(BESIDE, 600.0 * SPREAD[5] + 240.0 * SPREAD[6])
    assert times_found(2073, mean + np.outer(34.0 * hidden, SPREAD[6]), 10) >= 4


@pytest.mark.parametrize(
    ('pair', 'alike', 'repeats', 'ratio', 'least'),
    [
        ((1289, 2302), (1528, 2063), True, 1.0, 0),
        ((1289, 2302), (1528, 2063), True, 1.3, 20),
        ((2645, 1308), (861, 3092), False, 1.1, 16),
    ],
    ids=['equally bright', 'one brighter', 'alike but for the last four bits'],
)
def test_two_that_begin_together_are_not_two_of_the_same_sum(
    pair: tuple[int, int], alike: tuple[int, int], repeats: bool, ratio: float, least: int
) -> None:
    """Where they are equally bright, nothing tells which two of the same sum it is."""
    seen = slice(PACKET_BITS - 4)
    assert np.array_equal(sum(map(packet, pair))[seen], sum(map(packet, alike))[seen])  # type: ignore[index]
    first, second = (shown(one, repeats=repeats) for one in pair)
    mean = 10.0 + 150.0 * np.outer(first + ratio * second, SPREAD[5])
    found = Counter(number for seed in range(12) for number in read_in(mean, seed))
    assert found.keys() <= {*pair}
    assert found.total() >= least


def test_the_light_of_two_known_markers_is_no_third_packet() -> None:
    """Both are dark where 71 is dark, and nowhere both bright but in the preamble."""
    first, numbers = 2895, (3802, 1822, 1191, 1271, 1636)
    both, third = packet(first) + packet(numbers[3]), packet(71)
    assert np.array_equal(both[len(PREAMBLE) :] == 2, third[len(PREAMBLE) :] == 1)
    middle_s = np.arange(PERIOD_S / 2, START_S + 5.2 * PACKET_S, PERIOD_S)
    light = light_at(middle_s, sent(first, START_S, repeats=True))
    mean = 10.0 + 130.0 * np.outer(light, SPREAD[5])
    for index, number in enumerate(numbers):
        dark = 1 - light_at(middle_s, sent(number, START_S + index * PACKET_S))
        mean += np.outer(115.0 * (1 / len(numbers) - dark), SPREAD[5] + 0.5 * SPREAD[6])
    for seed in range(6):
        assert read_in(mean, seed, middle_s) == {first, *numbers}


def in_turn(numbers: tuple[int, ...], pause_bits: float, middle_s: Floats) -> Floats:
    """Return the light of a marker that sends packets with pauses."""
    every_s = PACKET_S + pause_bits * BIT_PERIOD_S
    light = np.ones_like(middle_s)
    for place, number in enumerate(numbers):
        light += light_at(middle_s, sent(number, START_S + place * every_s)) - 1
    return light


LONG_S = np.arange(PERIOD_S / 2, START_S + 5.5 * PACKET_S, PERIOD_S)


@pytest.mark.parametrize(
    ('number', 'pause_bits', 'other', 'gain'),
    [(3117, 1, 1707, 150.0), (2139, 2, 1195, 150.0), (1559, 1, 1365, 40.0), (4074, 9, 1626, 40.0)],
)
def test_a_marker_that_pauses_is_no_other(
    number: int, pause_bits: int, other: int, gain: float
) -> None:
    """The end of its packet, the pause and the next packet's beginning are another's packet."""
    bits = np.concatenate([packet(number), np.zeros(pause_bits), packet(number)])
    assert any(np.array_equal(bits[n : n + PACKET_BITS], packet(other)) for n in range(PACKET_BITS))
    mean = 10.0 + gain * np.outer(in_turn(4 * (number,), pause_bits, LONG_S), SPREAD[5])
    for seed in range(12):
        assert read_in(mean, seed, LONG_S) == {number}


def test_two_new_packets_are_not_a_known_one_and_another() -> None:
    """As one of those that are sent before, and a third, have their sum."""
    first, second = (3897, 3596), (3916, 3399)
    assert np.array_equal(packet(3596) + packet(3399), packet(3916) + packet(3079))
    light = in_turn(first, 0, LONG_S) + in_turn(second, 0, LONG_S)
    for seed in range(6):
        assert read_in(10.0 + 135.0 * np.outer(light, SPREAD[5]), seed, LONG_S) <= {*first, *second}


def test_what_a_neighbour_takes_away_is_no_marker() -> None:
    """The inverse of a word is a word."""
    for number in range(300, 4000, 370):
        light = in_turn(3 * (number,), 1, LONG_S)
        mean = np.outer(light, 600.0 * SPREAD[5] - 60.0 * SPREAD[6]) + 100.0
        assert read_in(mean, number, LONG_S) == {number}
