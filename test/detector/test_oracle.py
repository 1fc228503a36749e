# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core against the oracle in numpy: random windows, and what competes with a packet."""

from dataclasses import replace

import numpy as np
import pytest
from harness_core import (
    GRID,
    LAW,
    NATS,
    ONE_ZONE,
    PERIOD_S,
    Statistics,
    around,
    assert_agrees,
    light_at,
    noisy,
    sent,
)
from harness_frames import recording_of
from oracle import Sending, Zone, evidence, light, margin, part_margin, sequence_margin, word

from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, PACKET_S, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.model import Status

SILENCE_S = 1.0  # before the first packet in question


def random_markers(
    core: Statistics,
    rng: np.random.Generator,
    packets: int,
    *,
    repeats: bool | None = None,
    samples: int | None = None,
) -> list[Sending]:
    """Show markers of all kinds to the core, on levels that wander, with samples that are missing.

    Some repeat, if it is not said whether they do; after so many `samples`, all are missing.
    """
    middle_s = np.arange(PERIOD_S / 2, SILENCE_S + (packets + 1) * PACKET_S, PERIOD_S)
    middle_s += np.clip(rng.standard_normal(len(middle_s)), -2, 2) * rng.uniform(0, 0.004)
    kept = rng.random(len(middle_s)) >= rng.choice([0.0, 0.1, 0.3])
    middle_s = middle_s[kept]
    shape = (len(middle_s), GRID.zones)
    sendings: list[Sending] = []
    signal = np.empty(shape)
    for zone in range(GRID.zones):
        sending = sent(
            rng.choice(USABLE_IDS),
            repeats=bool(rng.random() < 0.5) if repeats is None else repeats,
            start_s=SILENCE_S + BIT_PERIOD_S * rng.uniform(-2, 2),
            bit_s=BIT_PERIOD_S * rng.uniform(0.98, 1.02),
        )
        sendings.append(sending)
        bright = 10 ** rng.uniform(0.5, 3)
        walk = rng.choice([0.0, 0.02, 0.2]) * bright
        sway = 1 + rng.uniform(0, 0.5) * np.sin(rng.uniform(1, 8) * middle_s)
        mean = rng.choice([4.0, 40.0]) + bright * sway * light_at(middle_s, sending)
        mean += np.cumsum(walk * rng.standard_normal(len(mean)))
        mean = np.maximum(mean, 0)
        noise = rng.choice([0.2, 1.0, 3.0]) * np.sqrt(LAW.variance(mean))
        signal[:, zone] = mean + noise * rng.standard_normal(len(mean))
    recording = recording_of(middle_s, np.maximum(signal, 0))
    missing = rng.random(shape) < rng.choice([0.0, 0.05, 0.3], GRID.zones)
    recording.status[missing] = rng.choice([0, 4, Status.NO_TARGET], np.count_nonzero(missing))
    if samples is not None:
        recording.status[samples:] = 0
    core.take(recording, LAW, BIT_PERIOD_S)
    return sendings


def id_of(sending: Sending) -> int:
    return int(USABLE_IDS[(packet(USABLE_IDS) == sending.bits).all(axis=1)][0])


@pytest.mark.parametrize(('seed', 'packets'), enumerate([1] * 6 + [2, 5]))
def test_likelihoods_of_random_windows(core: Statistics, seed: int, packets: int) -> None:
    rng = np.random.default_rng(seed)
    sendings = random_markers(core, rng, packets)
    for zone in rng.choice(GRID.zones, 6 if packets == 1 else 2, replace=False):
        sending = sendings[zone]
        from_s = sending.start_s - rng.uniform(0, 16) * BIT_PERIOD_S
        to_s = sending.start_s + packets * PACKET_S + rng.uniform(-5, 5) * BIT_PERIOD_S
        null, rows = core.open(from_s, to_s, zone)
        assert_agrees(core, core.rows(zone).zone(LAW, rows), null, around(sending, rng))


@pytest.mark.parametrize('seed', range(3))
def test_likelihoods_of_gains_that_change(core: Statistics, seed: int) -> None:
    rng = np.random.default_rng(60 + seed)
    sendings = random_markers(core, rng, 1)
    knots = core.lib.RL_KNOTS
    for zone in rng.choice(GRID.zones, 4, replace=False):
        sending, other = sendings[zone], sendings[zone - 1]
        core.open(sending.start_s, sending.start_s + PACKET_S, zone)
        rows, held = core.opened(), core.rows(zone)
        seen = held.zone(LAW, rows)
        if seed > 0:
            core.lib.rl_window_add(core.window, core.given(other))
            seen.add_interferer(light(other, *seen.times))
        core.window.gain_changes = True
        at = np.linspace(0, knots - 1, rows.stop - rows.start)[held.valid[rows]]
        weights = np.maximum(1 - abs(at[:, None] - np.arange(knots)), 0)
        best = seen.fit_knots(light(sending, *seen.times), weights)
        found = core.attempt(sending)
        # The best set of gains that are not zero is not always found.
        assert best - 0.5 < found.log_likelihood < best + NATS
        core.window.gain_changes = False
        assert core.attempt(sending).log_likelihood < best + 5.0


def test_likelihoods_of_sums_of_zones(core: Statistics) -> None:
    rng = np.random.default_rng(10)
    sendings = random_markers(core, rng, 1)
    for source, zones in ((17, 4), (25, 9), (29, 16)):  # squares, up to the whole view
        null, rows = core.open(SILENCE_S - 0.4, SILENCE_S + PACKET_S, source)
        held = core.rows(source).zone(replace(LAW, floor=LAW.floor * zones), rows)
        assert_agrees(core, held, null, around(sendings[0], rng))


@pytest.mark.parametrize('samples', [0, 1, 2, 3])
def test_likelihoods_of_next_to_no_samples(core: Statistics, samples: int) -> None:
    rng = np.random.default_rng(samples)
    sendings = random_markers(core, rng, 1, samples=samples)
    null, rows = core.open(0.0, SILENCE_S + PACKET_S, 0)
    sending = sendings[0]._replace(start_s=0.0)
    if samples:
        assert_agrees(core, core.rows(0).zone(LAW, rows), null, [sending])
    else:
        assert core.attempt(sending).log_likelihood == pytest.approx(null)


@pytest.mark.parametrize(('packets', 'repeats'), [(1, False), (1, True), (3, True)])
def test_word_and_margin_decided(core: Statistics, packets: int, repeats: bool) -> None:
    core.start_codebook()
    rng = np.random.default_rng(20)
    sendings = random_markers(core, rng, packets, repeats=repeats)
    judged = 0
    for zone in range(0, GRID.zones, 2):
        # A search finds clocks in steps.
        sending, off = sendings[zone], rng.uniform(-0.01, 0.01)
        sending = sending._replace(
            start_s=sending.start_s - off * packets * PACKET_S / 2, bit_s=sending.bit_s * (1 + off)
        )
        others = rng.choice(USABLE_IDS, 3, replace=False)
        rivals = [sending._replace(bits=sent(other, 0.0).bits) for other in others]
        to_s = sending.start_s + packets * PACKET_BITS * sending.bit_s + 0.02
        hits = [(id_of(sending), sending), *zip(others, rivals, strict=True)]
        verdict = core.decide(zone, packets, to_s, hits)
        if verdict.reason != core.lib.RL_READ:
            continue
        judged += 1
        zones = [core.rows(zone).zone(LAW, core.opened())]
        last = verdict.transmission
        final = sending._replace(start_s=last.start_s, bit_s=last.bit_s)
        follows = core.lib.rl_window_follow_gain(core.window, core.given(final)) > 0
        core.window.gain_changes = False
        # Bits of other clocks may be likelier still.
        wanted = max(word(zones, final), core.other_clock(final, packets))
        if packets == 1 and not follows:
            assert verdict.word == pytest.approx(wanted, abs=NATS)
        elif not follows:
            # Each packet may have bits of its own.
            assert wanted - NATS < verdict.word < wanted + 20
        # It is refined once more after that is noted.
        beyond = verdict.evidence - evidence(zones, final)
        assert -NATS < beyond < (10 if follows else NATS)
        # There may be likelier ones than those that were given.
        assert 0 < verdict.margin < margin(zones, final, rivals) + NATS
    assert judged >= 4


def test_a_train_may_be_given_by_any_of_its_packets(core: Statistics) -> None:
    """Also by one that begins after the window."""
    core.start_codebook()
    sending = random_markers(core, np.random.default_rng(4), 3, repeats=True)[0]
    to_s = sending.start_s + 3 * PACKET_BITS * sending.bit_s
    words = []
    for packets in (0, 1, 4):
        later_s = packets * PACKET_BITS * sending.bit_s
        begun = sending._replace(start_s=sending.start_s + later_s)
        verdict = core.decide(0, 3, to_s, [(id_of(sending), begun)])
        assert verdict.reason == core.lib.RL_READ
        words.append(verdict.word)
    assert words == pytest.approx(words[:1] * 3, abs=0.1)


ABOUT = 3.0
"""The same where the core does not try a rival exactly [nats]."""
MIDDLE_S = PERIOD_S * np.arange(80)
"""Times of the core count from the middle of the first exposure."""


def take_lights(core: Statistics, rng: np.random.Generator, seen: Floats) -> None:
    """Let zone 0 see some light, of shape (80,), on a wall, and the others the wall."""
    mean = 10 + 200 * np.outer(seen, ONE_ZONE)
    core.take(noisy(MIDDLE_S, mean, rng), LAW, BIT_PERIOD_S)


def shown(sending: Sending) -> Floats:
    return light_at(MIDDLE_S, sending)


def test_interferers_are_fitted_along(core: Statistics) -> None:
    rng = np.random.default_rng(40)
    first, second = sent(2073, -0.31, repeats=True), sent(1234, -0.77, repeats=True)
    take_lights(core, rng, shown(first) + 0.7 * shown(second))
    known = core.window.interference
    known.count = 1
    known.train[0].transmission = core.given(second)[0]
    known.train[0].begin_s, known.train[0].end_s = -1.0, 2.0
    null, rows = core.open(0.1, 0.1 + PACKET_S, 0)
    known.count = 0
    zone = core.rows(0).zone(LAW, rows)
    zone.add_interferer(light(second, *zone.times))
    assert_agrees(core, zone, null, around(first, rng))
    alone = core.rows(0).zone(LAW, rows)
    assert evidence([zone], first) > 2 * evidence([alone], first)


NUMBERS = (2073, 1234, 3000, 77)


def one_of_four(
    core: Statistics, seed: int, seen: Floats, number: int
) -> tuple[list[Zone], Floats, list[Floats]]:
    """Open the window of a packet at 0.1 s; return it, when rows begin, and bits of other IDs."""
    core.start_codebook(sorted(NUMBERS))
    take_lights(core, np.random.default_rng(seed), seen)
    _, rows = core.open(0.1, 0.1 + PACKET_S, 0)
    held = core.rows(0)
    others = [sent(other, 0.0).bits for other in NUMBERS if other != number]
    return [held.zone(LAW, rows)], held.begin_s[rows], others


@pytest.mark.parametrize('bits', [11, 19])
def test_two_packets_back_to_back_compete_with_one(core: Statistics, bits: int) -> None:
    end_s = 0.1 + bits * BIT_PERIOD_S
    ended, begun = sent(2073, end_s - PACKET_S), sent(1234, end_s)
    zones, _, others = one_of_four(core, bits, shown(ended) + shown(begun) - 1, 3000)
    judged = sent(3000, 0.1, repeats=True)
    cut, found, _ = core.margins(judged, 3000)
    assert found == pytest.approx(sequence_margin(zones, judged, cut.begin_s, others), abs=NATS)
    assert found < -20


@pytest.mark.parametrize(('start_s', 'seen_from'), [(-0.2, 30), (-0.4, 42), (-0.5, 48)])
def test_other_ids_of_what_appeared_compete(
    core: Statistics, start_s: float, seen_from: int
) -> None:
    appeared = sent(2073, start_s, repeats=True)
    seen = np.where(np.arange(80) >= seen_from, shown(appeared), 0.0)
    zones, rows_s, others = one_of_four(core, seen_from, seen, 2073)
    _, _, found = core.margins(appeared, 2073)
    wanted = part_margin(zones, appeared, rows_s, others)
    # The core tries those few that are likeliest by what single bits do.
    assert wanted - ABOUT < found < max(wanted, 0.0) + 2 * ABOUT
    assert found < 25


@pytest.mark.parametrize('late_s', [0.0, 0.1, 0.2])
def test_a_lone_packet_is_not_taken_for_one_that_repeats(core: Statistics, late_s: float) -> None:
    core.start_codebook()
    hits = [(2073, sent(2073, 0.1, repeats=True))]
    for repeats, reason in ((True, core.lib.RL_READ), (False, core.lib.RL_INCOMPLETE)):
        take_lights(core, np.random.default_rng(0), shown(sent(2073, 0.1, repeats=repeats)))
        assert core.decide(0, 1, 0.1 + PACKET_S + late_s, hits).reason == reason


@pytest.mark.parametrize('late_s', [0.1, 0.2])
def test_a_packet_after_one_of_another_id_has_not_repeated(core: Statistics, late_s: float) -> None:
    core.start_codebook()
    before, after = sent(2073, -0.8, repeats=True), sent(1234, 0.5, repeats=True)
    seen = np.where(MIDDLE_S + PERIOD_S < 0.5, shown(before), shown(after))
    take_lights(core, np.random.default_rng(0), seen)
    # Hits begin before their stretch.
    hit = after._replace(start_s=after.start_s - PACKET_S)
    verdict = core.decide(0, 1, 0.5 + PACKET_S - late_s, [(1234, hit)])
    assert verdict.reason == core.lib.RL_INCOMPLETE
