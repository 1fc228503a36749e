# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from retrolidar_ros.code import IDS, PACKET_BITS, packet
from retrolidar_ros.detector.soft_bits import Integral, SoftBits
from retrolidar_ros.detector.words import WordBank, template_energy
from retrolidar_ros.frame import Floats

SAMPLE_S = 0.021
BIT_S = 2 * SAMPLE_S
PACKET_SAMPLES = 2 * PACKET_BITS
PHASES = (0.0, 0.25, 0.5, 0.75)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def bank() -> WordBank:
    return WordBank()


def exposures(count: int, lost: tuple[int, ...] = ()) -> tuple[Floats, Floats]:
    kept = np.setdiff1d(np.arange(count), lost)
    return kept * SAMPLE_S, (kept + 1) * SAMPLE_S


def exact(begin_s: Floats, end_s: Floats, values: Floats, first_s: float, last_s: float) -> Floats:
    overlap = np.minimum(end_s, last_s) - np.maximum(begin_s, first_s)
    total: Floats = np.maximum(overlap, 0) / (end_s - begin_s) @ values
    return total


def between(integral: Integral, times_s: Floats) -> Floats:
    """Return the integral over each of the intervals between times."""
    until = integral.until(*integral.locate(times_s), slice(None))
    return np.diff(until, axis=0)


@pytest.mark.parametrize('lost', [(), (10,), (7, 8, 9, 30)])
def test_the_integral_is_the_share_of_every_exposure(
    lost: tuple[int, ...], rng: np.random.Generator
) -> None:
    begin_s, end_s = exposures(40, lost)
    values = rng.uniform(0, 50, (len(begin_s), 3))
    integral = Integral(begin_s, end_s, values)
    for first_s, last_s in np.sort(rng.uniform(-0.1, 40 * SAMPLE_S + 0.1, (200, 2)), axis=1):
        found = between(integral, np.array([first_s, last_s]))[0]
        assert found == pytest.approx(exact(begin_s, end_s, values, first_s, last_s), abs=1e-9)


def test_integrals_over_adjacent_intervals_add_up(rng: np.random.Generator) -> None:
    begin_s, end_s = exposures(40, (11, 12))
    integral = Integral(begin_s, end_s, rng.uniform(0, 50, (len(begin_s), 3)))
    times_s = np.sort(rng.uniform(0, 40 * SAMPLE_S, 30))
    whole = between(integral, times_s[[0, -1]])[0]
    assert between(integral, times_s).sum(axis=0) == pytest.approx(whole, abs=1e-9)
    # Many hypotheses at a time are the same as one.
    index, share = integral.locate(times_s.reshape(5, 6))
    together = integral.until(index, share, slice(1, 2))
    assert together.shape == (5, 6, 1)
    alone = integral.until(*integral.locate(times_s), slice(1, 2))
    assert together.reshape(30, 1).tolist() == alone.tolist()


def test_nothing_falls_into_a_gap() -> None:
    begin_s, end_s = exposures(40, tuple(range(10, 20)))
    integral = Integral(begin_s, end_s, np.full((30, 1), 7.0))
    gap_s = np.array([10, 11.3, 15, 19.99, 20]) * SAMPLE_S
    assert between(integral, gap_s) == pytest.approx(np.zeros((4, 1)), abs=1e-9)
    around_s = np.array([9, 21]) * SAMPLE_S
    assert between(integral, around_s) == pytest.approx(np.array([[14.0]]))


def boxes(bits: Floats, phase: float, *, repeats: bool) -> Floats:
    """Return what 63 exposures see of bits that are dark by 1 and begin at a phase of the first."""
    fine = 400  # steps of an exposure; a quarter of one is a whole number of them
    dark = np.repeat(bits, 2 * fine)
    late = round(phase * fine)
    if repeats:
        seen = np.roll(np.concatenate([dark, dark]), late)[: (PACKET_SAMPLES + 1) * fine]
    else:
        seen = np.concatenate([np.zeros(late), dark, np.zeros(fine - late)])
    shares: Floats = seen.reshape(PACKET_SAMPLES + 1, fine).mean(axis=1)
    return shares


@pytest.mark.parametrize('phase', PHASES)
def test_template_energy_is_that_of_sampled_boxes(phase: float, rng: np.random.Generator) -> None:
    for bits in packet(rng.integers(0, IDS, 50)).astype(float):
        dark = bits.sum()
        # A lone packet ends where nothing follows; a repeating one is followed by itself.
        for repeats, pairs in ((False, bits[:-1] @ bits[1:]), (True, bits @ np.roll(bits, -1))):
            seen = boxes(bits, phase, repeats=repeats)
            if repeats:
                seen = seen[:PACKET_SAMPLES]
            expected = (seen**2).sum() - seen.sum() ** 2 / PACKET_SAMPLES
            energy = template_energy(dark, pairs, PACKET_SAMPLES, np.asarray(phase))
            assert energy == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize('phase', [*PHASES, 0.1, 0.65])
def test_the_sent_packet_explains_all_that_a_repeating_marker_shows(
    phase: float, bank: WordBank, rng: np.random.Generator
) -> None:
    ids = rng.integers(1, IDS - 1, 40)
    dark = np.array([boxes(bits, phase, repeats=True) for bits in packet(ids).astype(float)]).T
    begin_s, end_s = exposures(PACKET_SAMPLES + 1)
    signal = 30 - 20 * dark
    signal -= signal.mean(axis=0)
    integral = Integral(begin_s, end_s, np.concatenate([signal, signal**2], axis=1))
    edges_s = phase * SAMPLE_S + BIT_S * np.arange(PACKET_BITS + 1)
    soft = SoftBits(integral, len(ids), edges_s[None], 0.0)
    assert soft.phase[0] == pytest.approx(phase, abs=1e-6)
    level = soft.steady(1)
    phases = np.full(len(ids), phase)
    best = bank.best(level.value[0].T, level.energy[0], phases, PACKET_SAMPLES)
    assert best.ids.tolist() == ids.tolist()
    assert best.correlation == pytest.approx(np.ones(len(ids)), abs=1e-5)
    # And no packet can explain more than the bound.
    bound = bank.bound(level.value, PACKET_SAMPLES)[0]
    assert (bound > 0.999 * np.sqrt(level.energy[0])).all()


def test_soft_bits_are_how_much_darker_than_the_mean_each_bit_is(rng: np.random.Generator) -> None:
    begin_s, end_s = exposures(PACKET_SAMPLES)
    signal = rng.uniform(0, 50, (PACKET_SAMPLES, 2))
    integral = Integral(begin_s, end_s, np.concatenate([signal, signal**2], axis=1))
    soft = SoftBits(integral, 2, BIT_S * np.arange(PACKET_BITS + 1)[None], 0.0)
    level = soft.steady(1)
    expected = 2 * signal.mean(axis=0) - signal.reshape(PACKET_BITS, 2, 2).sum(axis=1)
    assert level.value[0] == pytest.approx(expected, abs=1e-9)
    assert level.energy[0] == pytest.approx(PACKET_SAMPLES * signal.var(axis=0))
    assert level.told[0] == pytest.approx([PACKET_SAMPLES])


def test_a_straight_line_is_taken_off_a_marker_that_moves() -> None:
    begin_s, end_s = exposures(PACKET_SAMPLES)
    line = np.linspace(10, 40, PACKET_SAMPLES)[:, None]
    integral = Integral(begin_s, end_s, np.concatenate([line, line**2], axis=1))
    soft = SoftBits(integral, 1, BIT_S * np.arange(PACKET_BITS + 1)[None], 0.0)
    assert soft.steady(1).value[0].max() > 20
    assert soft.drifting().value[0] == pytest.approx(np.zeros((PACKET_BITS, 1)), abs=1e-9)


def test_a_bank_holds_the_registered_and_usable_ids_only() -> None:
    assert WordBank([7, 3, 7, 0]).ids.tolist() == [3, 7]
    assert WordBank().ids.tolist() == list(range(1, IDS - 1))
    with pytest.raises(ValueError, match='no usable ID'):
        WordBank([0, IDS - 1])
