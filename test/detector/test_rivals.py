# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What competes with a packet, by the core and by the oracle: other packets and other IDs."""

import numpy as np
import pytest
from harness_core import GRID, LAW, NATS, PERIOD_S, Statistics, around, assert_agrees
from harness_frames import recording_of
from oracle import Sending, Zone, evidence, light, part_margin, sequence_margin, without

from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.sensor.frame import Floats

PACKET_S = PACKET_BITS * BIT_PERIOD_S
ABOUT = 3.0
"""The same where the core does not try a rival exactly [nats]."""
EXPOSURES = (PERIOD_S * np.arange(80), PERIOD_S * np.arange(1, 81))


def take_lights(core: Statistics, rng: np.random.Generator, seen: Floats) -> None:
    """Let zone 0 see some light, of shape (80,), on a wall, and the others the wall."""
    mean = 10 + 200 * seen[:, None] * (np.arange(GRID.zones) == 0)
    signal = mean + np.sqrt(LAW.variance(mean)) * rng.standard_normal(mean.shape)
    stamp_ns = np.rint(1e9 * (EXPOSURES[0] + PERIOD_S / 2)).astype(np.int64)
    core.take(recording_of(stamp_ns, np.maximum(signal, 0)), LAW, BIT_PERIOD_S)


def sent_since(number: int, start_s: float, *, repeats: bool = True) -> Sending:
    """Return a packet; times of the core count from the middle of the first exposure."""
    return Sending(packet(number).astype(np.float64), repeats, start_s, BIT_PERIOD_S)


def shown(sending: Sending) -> Floats:
    """Return the light of the exposures of `take_lights`."""
    start_s = sending.start_s + PERIOD_S / 2
    return light(sending._replace(start_s=start_s), *EXPOSURES)


def test_interferers_are_fitted_along(core: Statistics) -> None:
    rng = np.random.default_rng(40)
    first, second = sent_since(2073, -0.31), sent_since(1234, -0.77)
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


@pytest.mark.parametrize('bits', [11, 19])
def test_two_packets_back_to_back_compete_with_one(core: Statistics, bits: int) -> None:
    core.start_codebook(sorted(NUMBERS))
    rng = np.random.default_rng(bits)
    end_s = 0.1 + bits * BIT_PERIOD_S
    ended = sent_since(2073, end_s - PACKET_S, repeats=False)
    begun = sent_since(1234, end_s, repeats=False)
    take_lights(core, rng, shown(ended) + shown(begun) - 1)
    _, rows = core.open(0.1, 0.1 + PACKET_S, 0)
    zones = [core.rows(0).zone(LAW, rows)]
    judged = sent_since(3000, 0.1)
    cut, found, _ = core.margins(judged, 3000)
    others = [packet(number).astype(np.float64) for number in NUMBERS if number != 3000]
    assert found == pytest.approx(sequence_margin(zones, judged, cut.begin_s, others), abs=NATS)
    assert found < -20


@pytest.mark.parametrize(('start_s', 'seen_from'), [(-0.2, 30), (-0.4, 42), (-0.5, 48)])
def test_other_ids_of_what_appeared_compete(
    core: Statistics, start_s: float, seen_from: int
) -> None:
    core.start_codebook(sorted(NUMBERS))
    sent = sent_since(2073, start_s)
    seen = np.where(np.arange(80) >= seen_from, shown(sent), 0.0)
    take_lights(core, np.random.default_rng(seen_from), seen)
    _, rows = core.open(0.1, 0.1 + PACKET_S, 0)
    zones = [core.rows(0).zone(LAW, rows)]
    _, _, found = core.margins(sent, 2073)
    others = [packet(number).astype(np.float64) for number in NUMBERS if number != 2073]
    wanted = part_margin(zones, sent, core.rows(0).begin_s[rows], others)
    # The core tries those few that are likeliest by what single bits do.
    assert wanted - ABOUT < found < max(wanted, 0.0) + 2 * ABOUT
    assert found < 25


@pytest.mark.parametrize('late_s', [0.0, 0.1, 0.2])
def test_a_lone_packet_is_not_taken_for_one_that_repeats(core: Statistics, late_s: float) -> None:
    core.start_codebook()
    repeating = sent_since(2073, 0.1)
    for repeats, reason in ((True, core.lib.RL_READ), (False, core.lib.RL_INCOMPLETE)):
        sent = repeating._replace(repeats=repeats)
        take_lights(core, np.random.default_rng(0), shown(sent))
        hits = [(2073, repeating)]
        assert core.decide(0, 1, 0.1 + PACKET_S + late_s, hits).reason == reason


@pytest.mark.parametrize('late_s', [0.1, 0.2])
def test_a_packet_after_one_of_another_id_has_not_repeated(core: Statistics, late_s: float) -> None:
    core.start_codebook()
    before, after = sent_since(2073, -0.8), sent_since(1234, 0.5)
    seen = np.where(EXPOSURES[1] < 0.5, shown(before), shown(after))
    take_lights(core, np.random.default_rng(0), seen)
    # Hits begin before their stretch.
    hit = after._replace(start_s=after.start_s - PACKET_S)
    verdict = core.decide(0, 1, 0.5 + PACKET_S - late_s, [(1234, hit)])
    assert verdict.reason == core.lib.RL_INCOMPLETE


@pytest.mark.parametrize('share', [0.7, 0.3])
def test_a_packet_that_is_taken_off_leaves_the_other_one(core: Statistics, share: float) -> None:
    rng = np.random.default_rng(30)
    begin_s = PERIOD_S * np.arange(80)
    exposures = (begin_s, begin_s + PERIOD_S)
    first, second = (
        Sending(packet(number).astype(np.float64), True, start_s, bit_s)
        for number, start_s, bit_s in ((2073, -0.31, 0.0421), (1234, -0.77, 0.0418))
    )
    mean = 10 + 200 * (light(first, *exposures) + share * light(second, *exposures))
    signal = mean + np.sqrt(LAW.variance(mean)) * rng.standard_normal(80)
    fitted = Zone(*exposures, signal, period_s=PERIOD_S, least=1.0).fit(first)
    left = without(first, *exposures, signal, fitted.gain)
    stamp_ns = np.rint(1e9 * (begin_s + PERIOD_S / 2)).astype(np.int64)
    both = np.stack([signal, left] * 8, axis=1)
    core.take(recording_of(stamp_ns, both), LAW, BIT_PERIOD_S)
    # Times of the core count from the middle of the first exposure.
    tried = [one._replace(start_s=one.start_s - PERIOD_S / 2) for one in (first, second)]
    nats = []
    for zone in (0, 1):
        null, rows = core.open(0.1, 1.6, zone)
        held = core.rows(zone).zone(LAW, rows)
        assert_agrees(core, held, null, tried)
        nats.append([evidence([held], sending) for sending in tried])
    assert nats[0][0] > nats[0][1]
    assert nats[1][0] < 8 < 28 < nats[1][1]
    assert nats[1][1] > nats[0][1]
