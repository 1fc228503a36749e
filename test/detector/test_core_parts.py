# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Gains that change, targets, memory and codebook of the core against plain numpy."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from harness_core import GRID, KEPT, LAW, PERIOD_S, Statistics, bind_core, constant, light_at, sent
from harness_frames import recording_of
from numpy.typing import NDArray

from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, PREAMBLE, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import GRIDS, Floats, ZoneGrid


@pytest.mark.parametrize('grid', GRIDS.values(), ids=lambda grid: f'{grid.zones} zones')
def test_the_arrays_of_a_search_lie_within_its_memory(core: Statistics, grid: ZoneGrid) -> None:
    frames = recording_of(np.zeros(1), np.ones((1, grid.zones)))
    core.take(replace(frames, grid=grid), LAW, BIT_PERIOD_S)
    view, memory = core.ffi.new('struct rl_view *'), core.ffi.new('struct rl_memory *')
    core.lib.rl_view_start(view, core.samples, memory)
    asked, memory.taken = memory.taken, 0
    block = memory.block = core.ffi.new('char[]', asked)
    core.lib.rl_view_start(view, core.samples, memory)
    end = view.room[len(view.room) - 1].valid + KEPT
    assert core.ffi.cast('char *', end) - block <= memory.taken == asked


@pytest.mark.parametrize('sway', [0.0, 0.4])
@pytest.mark.parametrize('lasting_s', [1.5, 9.0], ids=['stopped', 'continues'])
def test_what_interferes_is_subtracted(core: Statistics, sway: float, lasting_s: float) -> None:
    rng = np.random.default_rng(40)
    time_s = PERIOD_S * np.arange(120)
    read, third = sent(2073, -0.3, repeats=True), sent(1234, 0.2, repeats=True)
    lit = np.where(time_s < lasting_s, light_at(time_s, read), 1.0)
    noise, left = 3 * rng.standard_normal(120), 40 * light_at(time_s, third)
    signals = np.full((120, GRID.zones), 5.0)
    signals[:, 0] = 20 + 100 * (1 + sway * np.sin(2 * time_s)) * lit + left + noise
    core.take(recording_of(time_s, signals), LAW, BIT_PERIOD_S)
    core.window.interference = {
        'count': 1,
        'train': [{'transmission': core.given(read)[0], 'begin_s': -1.0, 'end_s': 1.5}],
    }
    _, rows = core.open(0.0, 3.0, 0)
    rest = core.array(core.rows(0).signal[rows], 'float')
    core.lib.rl_unwhiten(core.ffi.addressof(core.window, 'whitened'), rest)
    assert np.std(np.diff(list(rest)) - np.diff(left)) < 0.31 * np.std(np.diff(100 * lit))


def column_of(
    core: Statistics, signal: Floats, distance: Floats
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Return signal and validity of zone 0, whose frames these are, as a window sees it."""
    shape = (len(signal), GRID.zones)
    signals, distances = np.full(shape, 5.0), np.ones(shape)
    signals[:, 0], distances[:, 0] = signal, distance
    core.take(
        recording_of(PERIOD_S * np.arange(len(signal)), signals, distances), LAW, BIT_PERIOD_S
    )
    return core.column(0)


def test_of_two_targets_by_turns_the_dimmer_one_is_the_dark_marker(core: Statistics) -> None:
    rng = np.random.default_rng(50)
    dark = rng.random(90) < 0.5
    signal = np.where(dark, 30.0, 100.0) + rng.uniform(0, 5, 90)
    distance = np.where(dark, 3.0, 1.0) + rng.uniform(-0.1, 0.1, 90)
    for turned in (distance, 4.0 - distance):
        seen, valid = column_of(core, signal, turned)
        assert valid.all()
        np.testing.assert_allclose(seen, np.where(dark, 0.0, signal), rtol=1e-6)


def test_one_target_is_taken_as_it_is_and_a_hand_is_an_erasure(core: Statistics) -> None:
    rng = np.random.default_rng(51)
    signal, distance = rng.uniform(0, 100, 90), rng.uniform(2.0, 2.45, 90)
    seen, valid = column_of(core, signal, distance)
    assert valid.all()
    np.testing.assert_allclose(seen, signal, rtol=1e-6)
    hand = np.arange(90) // 10 == 4
    seen, valid = column_of(core, signal, np.where(hand, 0.5, 2.0))
    np.testing.assert_array_equal(valid, ~hand)
    np.testing.assert_allclose(seen, np.where(hand, signal[39], signal), rtol=1e-6)


@pytest.mark.parametrize('registered', [4094, 300, 30, 3, 1])
def test_the_codebook_finds_the_two_best_packets(core: Statistics, registered: int) -> None:
    rng = np.random.default_rng(registered)
    ids = np.sort(rng.choice(USABLE_IDS, registered, replace=False))
    assert core.start_codebook(ids) == registered
    smoothing, words = core.ffi.new('struct rl_smooth *'), core.ffi.new('struct rl_word[2]')
    for case in range(40):
        own, adjacent = rng.uniform(1.2, 2.0), rng.uniform(0, 0.3)
        smooth, pair, decay = rng.uniform(0, [0.1, 0.1, 0.9] if case % 5 else [0.5, 0.5, 0.9])
        lags = np.append(smooth, pair * decay ** np.arange(PACKET_BITS - 1))
        soft = rng.standard_normal(PACKET_BITS)
        if case % 2:
            soft += rng.uniform(0, 3) * (2.0 * packet(rng.choice(ids)) - 1)
        # Of every fourth, only the last bits of a window are seen, and it begins in the middle.
        is_part = case % 4 > 2
        shift = case % PACKET_BITS if is_part else 0
        seen = np.arange(PACKET_BITS) >= (PACKET_BITS - 20 if is_part else 0)
        soft *= np.roll(seen, -shift)
        packets = packet(ids).astype(np.float64)
        sums = packets @ soft
        bits = np.roll(packets, shift, axis=1) * seen
        # Pairs of dark bits of each packet, by how far they are apart, shape (bits, ids).
        apart = range(PACKET_BITS)
        pairs = np.stack([(bits[:, n:] * bits[:, : PACKET_BITS - n]).sum(axis=1) for n in apart])
        energy = own * pairs[0] + 2 * adjacent * pairs[1] - lags @ pairs
        # Whitening would leave less than nothing of some.
        energy = np.maximum(energy, constant('MIN_ENERGY') * own * bits.sum(axis=1))
        squared = np.where(sums > 0, sums**2 / energy, 0)
        least = rng.choice([0.0, 0.5 * squared.max(), 2 * squared.max()])
        expected = np.sort(squared[squared > least])[::-1][:2]
        given = core.ffi.new('struct rl_energy *', (own, adjacent, smooth, pair, decay))
        core.lib.rl_codebook_smooth(core.codebook, given, smoothing)
        heard = core.array(soft, 'float')
        mask = int(''.join(map(str, seen.astype(int))), 2)
        wanted = (mask, shift, least, words)
        core.lib.rl_codebook_best(core.codebook, given, smoothing, heard, *wanted)
        found = [one for one in words if one.index >= 0]
        np.testing.assert_allclose([one.squared for one in found], expected, rtol=1e-4)
        np.testing.assert_allclose(squared[[one.index for one in found]], expected, rtol=1e-4)


@pytest.mark.parametrize('registered', [4094, 30, 1])
def test_the_codebook_finds_the_heaviest_of_another_id(core: Statistics, registered: int) -> None:
    rng = np.random.default_rng(registered)
    ids = np.sort(rng.choice(USABLE_IDS, registered, replace=False))
    core.start_codebook(ids)
    for _ in range(40):
        weight = rng.standard_normal(PACKET_BITS)
        # The preamble is the same in all.
        heavy = packet(ids)[:, len(PREAMBLE) :] @ weight[len(PREAMBLE) :]
        excluded = rng.choice([ids[np.argmax(heavy)], 0])
        heavy[ids == excluded] = -np.inf
        heard = core.array(weight, 'float')
        found = core.lib.rl_codebook_heaviest(core.codebook, heard, int(excluded))
        if np.isfinite(heavy).any():
            assert heavy[found] == pytest.approx(heavy.max(), rel=1e-5)
        else:
            assert found == -1


def test_the_variation_of_a_zone_is_that_of_its_newest_packet(core: Statistics) -> None:
    """Of rows that come one by one, and after those that are held have moved."""
    rng = np.random.default_rng(70)
    rows = 62
    for frames in (3 * rows, 4 * KEPT + 10):
        signal = 50.0 + np.linspace(1, 9, frames)[:, None] * rng.standard_normal((frames, 16))
        core.take(recording_of(PERIOD_S * np.arange(frames), signal), LAW, BIT_PERIOD_S)
        assert core.samples.variance_rows == rows
        newest = signal[-rows:].astype(np.float32).astype(np.float64)
        expected = newest.var(axis=0, ddof=1) / LAW.variance(newest.mean(axis=0))
        for _ in range(2):
            found = [core.lib.rl_noise_variation(core.samples, zone) for zone in range(16)]
            np.testing.assert_allclose(found, expected, rtol=1e-6)
            core.lib.rl_noise_follow(core.samples, rows, True)


@pytest.fixture(scope='module')
def followed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Any]:
    """Give what follows markers: memory for it, and its functions."""
    return bind_core(tmp_path_factory, 'followed')


@pytest.mark.parametrize(
    ('zone', 'light', 'crossed', 'learns'),
    [
        (5, 1.0, False, True),  # the strongest
        (5, 0.7, False, False),  # in part of an exposure it may be the clock that is off
        (5, 0.7, True, True),
        (6, 1.0, True, True),  # beside it
        (6, 1.0, False, False),
        (7, 1.0, True, False),  # farther away
    ],
)
def test_a_gain_is_learnt_at_once_where_light_has_moved(
    followed: tuple[Any, Any], zone: int, light: float, crossed: bool, learns: bool
) -> None:
    ffi, lib = followed
    lights, samples = ffi.new('struct rl_zone_light[16]'), ffi.new('struct rl_zone_sample[16]')
    for one in lights:
        one.level, one.level_variance, one.gain_variance, one.excess = 10.0, 0.1, 0.1, 1.0
    lights[5].gain, lights[6].gain, lights[7].gain = 100.0, 40.0, 40.0
    before = lights[zone].gain
    samples[zone] = (True, 10.0 + light * (before + 60.0), 4.0)
    seen = {'step_s': 0.021, 'bit_s': 0.042, 'light': light, 'crossed': crossed}
    glance = ffi.new('struct rl_glance *', seen)
    held = ffi.new('struct rl_samples *', {'zones': 16, 'sensor': {'columns': 4}})
    lib.rl_zone_update(lights, held, samples, 5, glance)
    learnt = (lights[zone].gain - before) / 60.0
    assert learnt > 0.9 if learns else learnt < 0.1
    assert np.isfinite(lights[zone].gain_variance)


@pytest.mark.parametrize(('near', 'strongest'), [(0, 5), (5, 5), (8, 5), (10, 15), (3, 3)])
def test_a_marker_is_only_where_it_was_or_beside(
    followed: tuple[Any, Any], near: int, strongest: int
) -> None:
    """Light that is farther away is another marker's, however strong it is."""
    ffi, lib = followed
    lights = ffi.new('struct rl_zone_light[16]')
    lights[5].gain, lights[15].gain = 100.0, 300.0
    held = ffi.new('struct rl_samples *', {'zones': 16, 'sensor': {'columns': 4}})
    assert lib.rl_zone_strongest(lights, held, near) == strongest
    assert [lib.rl_zone_sees(lights, held, zone, 15) for zone in (15, 5)] == [True, False]
