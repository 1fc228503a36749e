# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core's statistics against the oracle in numpy, on random windows."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from harness_core import GRID, LAW, NATS, PERIOD_S, Statistics, around, assert_agrees
from harness_frames import recording_of
from numpy.typing import NDArray
from oracle import Sending, evidence, light, margin, word

from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.sensor.model import Status

PACKET_S = PACKET_BITS * BIT_PERIOD_S
SILENCE_S = 1.0  # before the first packet in question


class Sent(NamedTuple):
    """A recording, and what was sent in each of its zones."""

    recording: Recording
    sendings: list[Sending]


def stamps_ns(rng: np.random.Generator, lasting_s: float) -> NDArray[np.int64]:
    """Return stamps that jitter, of which some are lost."""
    middle_s = np.arange(PERIOD_S / 2, lasting_s, PERIOD_S)
    middle_s += np.clip(rng.standard_normal(len(middle_s)), -2, 2) * rng.uniform(0, 0.004)
    kept = rng.random(len(middle_s)) >= rng.choice([0.0, 0.1, 0.3])
    stamps: NDArray[np.int64] = np.rint(middle_s[kept] * 1e9).astype(np.int64)
    return stamps


def random_frames(rng: np.random.Generator, packets: int, *, repeats: bool | None = None) -> Sent:
    """Return markers of all kinds, on levels that wander, with samples that are missing.

    Parameters
    ----------
    rng : numpy.random.Generator
    packets : int
        How long the recording is after a silence.
    repeats : bool, optional
        Whether markers send more than one; some do if it is not given.
    """
    lasting_s = SILENCE_S + (packets + 1) * PACKET_S
    stamp_ns = stamps_ns(rng, lasting_s)
    middle_s = stamp_ns * 1e-9
    shape = (len(stamp_ns), GRID.zones)
    sendings: list[Sending] = []
    signal = np.empty(shape)
    for zone in range(GRID.zones):
        sending = Sending(
            bits=packet(rng.choice(USABLE_IDS)).astype(np.float64),
            repeats=bool(rng.random() < 0.5) if repeats is None else repeats,
            start_s=SILENCE_S + BIT_PERIOD_S * rng.uniform(-2, 2),
            bit_s=BIT_PERIOD_S * rng.uniform(0.98, 1.02),
        )
        sendings.append(sending)
        bright = 10 ** rng.uniform(0.5, 3)
        walk = rng.choice([0.0, 0.02, 0.2]) * bright
        sway = 1 + rng.uniform(0, 0.5) * np.sin(rng.uniform(1, 8) * middle_s)
        sent = light(sending, middle_s - PERIOD_S / 2, middle_s + PERIOD_S / 2)
        mean = rng.choice([4.0, 40.0]) + bright * sway * sent
        mean += np.cumsum(walk * rng.standard_normal(len(mean)))
        mean = np.maximum(mean, 0)
        noise = rng.choice([0.2, 1.0, 3.0]) * np.sqrt(LAW.variance(mean))
        signal[:, zone] = mean + noise * rng.standard_normal(len(mean))
    recording = recording_of(stamp_ns, np.maximum(signal, 0))
    missing = rng.random(shape) < rng.choice([0.0, 0.05, 0.3], GRID.zones)
    recording.status[missing] = rng.choice([0, 4, Status.NO_TARGET], np.count_nonzero(missing))
    return Sent(recording, sendings)


@pytest.mark.parametrize(('seed', 'packets'), enumerate([1] * 6 + [2, 5]))
def test_likelihoods_of_random_windows(core: Statistics, seed: int, packets: int) -> None:
    rng = np.random.default_rng(seed)
    sent = random_frames(rng, packets)
    core.take(sent.recording, LAW, BIT_PERIOD_S)
    for zone in rng.choice(GRID.zones, 6 if packets == 1 else 2, replace=False):
        sending = sent.sendings[zone]
        from_s = sending.start_s - rng.uniform(0, 16) * BIT_PERIOD_S
        to_s = sending.start_s + packets * PACKET_S + rng.uniform(-5, 5) * BIT_PERIOD_S
        null, rows = core.open(from_s, to_s, zone)
        assert_agrees(core, core.rows(zone).zone(LAW, rows), null, around(sending, rng))


def test_likelihoods_of_sums_of_zones(core: Statistics) -> None:
    rng = np.random.default_rng(10)
    sent = random_frames(rng, 1)
    core.take(sent.recording, LAW, BIT_PERIOD_S)
    for source, zones in ((17, 4), (25, 9), (29, 16)):  # squares, up to the whole view
        null, rows = core.open(SILENCE_S - 0.4, SILENCE_S + PACKET_S, source)
        held = core.rows(source).zone(replace(LAW, floor=LAW.floor * zones), rows)
        assert_agrees(core, held, null, around(sent.sendings[0], rng))


@pytest.mark.parametrize('samples', [0, 1, 2, 3])
def test_likelihoods_of_next_to_no_samples(core: Statistics, samples: int) -> None:
    rng = np.random.default_rng(samples)
    sent = random_frames(rng, 1)
    sent.recording.status[samples:] = 0
    core.take(sent.recording, LAW, BIT_PERIOD_S)
    null, rows = core.open(0.0, SILENCE_S + PACKET_S, 0)
    sending = sent.sendings[0]._replace(start_s=0.0)
    if samples:
        assert_agrees(core, core.rows(0).zone(LAW, rows), null, [sending])
    else:
        assert core.attempt(sending).log_likelihood == pytest.approx(null)


@pytest.mark.parametrize(('packets', 'repeats'), [(1, False), (1, True), (3, True)])
def test_word_and_margin_decided(core: Statistics, packets: int, repeats: bool) -> None:
    core.start_codebook()
    rng = np.random.default_rng(20)
    sent = random_frames(rng, packets, repeats=repeats)
    core.take(sent.recording, LAW, BIT_PERIOD_S)
    judged = 0
    for zone in range(0, GRID.zones, 2):
        # A search finds clocks in steps.
        sending, off = sent.sendings[zone], rng.uniform(-0.01, 0.01)
        sending = sending._replace(
            start_s=sending.start_s - off * packets * PACKET_S / 2, bit_s=sending.bit_s * (1 + off)
        )
        others = rng.choice(USABLE_IDS, 3, replace=False)
        rivals = [sending._replace(bits=packet(other).astype(np.float64)) for other in others]
        own = int(USABLE_IDS[(packet(USABLE_IDS) == sending.bits).all(axis=1)][0])
        to_s = sending.start_s + packets * PACKET_BITS * sending.bit_s + 0.02
        hits = [(own, sending), *zip(others, rivals, strict=True)]
        verdict = core.decide(zone, packets, to_s, hits)
        if verdict.reason != core.lib.RL_READ:
            continue
        judged += 1
        zones = [core.rows(zone).zone(LAW, core.opened())]
        last = verdict.transmission
        final = sending._replace(start_s=last.start_s, bit_s=last.bit_s)
        follows = core.lib.rl_window_follow_gain(core.window, core.given(final)) > 0
        core.lib.rl_window_steady(core.window)
        # Bits of other clocks may be likelier still.
        wanted = max(word(zones, final), core.other_clock(final, packets))
        if packets == 1 and not follows:
            assert verdict.word == pytest.approx(wanted, abs=NATS)
        elif not follows:
            # Each packet may have bits of its own.
            assert verdict.word > wanted - NATS
        # It is refined once more after that is noted.
        assert verdict.evidence < evidence(zones, final) + NATS
        # There may be likelier ones than those that were given.
        assert verdict.margin < margin(zones, final, rivals) + NATS
    assert judged >= 4


def test_a_train_may_be_given_by_any_of_its_packets(core: Statistics) -> None:
    """Also by one that begins after the window."""
    core.start_codebook()
    sent = random_frames(np.random.default_rng(4), 3, repeats=True)
    core.take(sent.recording, LAW, BIT_PERIOD_S)
    sending = sent.sendings[0]
    own = int(USABLE_IDS[(packet(USABLE_IDS) == sending.bits).all(axis=1)][0])
    to_s = sending.start_s + 3 * PACKET_BITS * sending.bit_s
    words = []
    for packets in (0, 1, 4):
        later_s = packets * PACKET_BITS * sending.bit_s
        begun = sending._replace(start_s=sending.start_s + later_s)
        verdict = core.decide(0, 3, to_s, [(own, begun)])
        assert verdict.reason == core.lib.RL_READ
        words.append(verdict.word)
    assert words == pytest.approx(words[:1] * 3, abs=0.1)
