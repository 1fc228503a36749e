# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stamps keep to the true time of the exposure, whatever clocks and transport do."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from retrolidar_ros.sensor.clock import MAX_SKEW, WINDOW_S, ClockMap
from retrolidar_ros.sensor.frame import Floats

PERIOD_S = 0.021
SLOW_PERIOD_S = 1 / 15
LEAST_DELAY_S = 0.005
START_NS = 1_700_000_000_000_000_000
BOOTED_US = 5_000_000

Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Run:
    """What a driver sees of some frames, and the truth; arrays of shape (frames,)."""

    true_s: Floats
    sensor_us: Integers
    host_ns: Integers
    """The host's clock at the middle of the exposure."""
    arrival_ns: Integers

    def only(self, kept: NDArray[np.bool_]) -> Run:
        """Lose the other frames."""
        return Run(*(values[kept] for values in vars(self).values()))

    def host_set(self, at_s: float, step_s: float) -> Run:
        """Set the host's clock once."""
        step_ns = np.where(self.true_s >= at_s, round(step_s * 1e9), 0)
        return replace(self, host_ns=self.host_ns + step_ns, arrival_ns=self.arrival_ns + step_ns)

    def stalled(self, at_s: float, length_s: float) -> Run:
        """Hold back for some time all that would arrive."""
        end_ns = START_NS + round((at_s + length_s) * 1e9)
        held = (self.arrival_ns > START_NS + round(at_s * 1e9)) & (self.arrival_ns < end_ns)
        return replace(self, arrival_ns=np.where(held, end_ns, self.arrival_ns))

    def at(self, start_s: float, stop_s: float = np.inf) -> NDArray[np.bool_]:
        return (self.true_s >= start_s) & (self.true_s < stop_s)


def simulate(
    length_s: float,
    skew: float = 0.0,
    seed: int = 0,
    period_s: float = PERIOD_S,
    sensor_error_s: Callable[[Floats], Floats] | None = None,
) -> Run:
    """Simulate a sensor whose clock is `skew` fast, and a transport that keeps the order.

    Frames jitter by 1 ms; delays are exponential with a mean of 2 ms over the least, and one
    frame in a hundred takes another 30 ms on average.
    """
    rng = np.random.default_rng(seed)
    count = round(length_s / period_s)
    jitter_s = rng.normal(0, 0.001, count).clip(-0.002, 0.002)
    true_s = period_s * np.arange(count) + jitter_s
    delay_s = LEAST_DELAY_S + rng.exponential(0.002, count)
    delay_s += (rng.random(count) < 0.01) * rng.exponential(0.03, count)
    error_s = skew * true_s if sensor_error_s is None else sensor_error_s(true_s)
    return Run(
        true_s,
        BOOTED_US + np.rint((true_s + error_s) * 1e6).astype(np.int64),
        START_NS + np.rint(true_s * 1e9).astype(np.int64),
        START_NS + np.rint(np.maximum.accumulate(true_s + delay_s) * 1e9).astype(np.int64),
    )


def map_all(clock_map: ClockMap, run: Run) -> Integers:
    pairs = zip(run.sensor_us.tolist(), run.arrival_ns.tolist(), strict=True)
    return np.array([clock_map.map(*pair) for pair in pairs], dtype=np.int64)


def errors_ms(run: Run, stamps_ns: Integers) -> Floats:
    return (stamps_ns - run.host_ns).astype(np.float64) / 1e6


def worst(errors: Floats) -> float:
    return float(np.abs(errors).max())


# Errors [ms] for clocks good to 1 %: before the rate is known, and later.
FIRST_MS, SECONDS_2_TO_10_MS, LATER_MS = 30.0, 1.0, 0.2
SKEWS = [-0.01, 0.0, 0.01]
skews = pytest.mark.parametrize('skew', SKEWS)


def check(
    run: Run, *spans: tuple[float, float, float], restarts: int = 0, set_back: bool = False
) -> None:
    """Check all stamps, and the errors from a second to another one: how large they may be [ms]."""
    clock_map = ClockMap(LEAST_DELAY_S)
    stamps_ns = map_all(clock_map, run)
    assert clock_map.restarts == restarts
    assert (np.diff(stamps_ns) <= 0).sum() == set_back
    assert (stamps_ns < run.arrival_ns).all()
    errors = errors_ms(run, stamps_ns)
    for start_s, stop_s, most_ms in spans:
        assert worst(errors[run.at(start_s, stop_s)]) < most_ms


@pytest.mark.parametrize(
    ('length_s', 'skew', 'seed', 'period_s', 'first_ms', 'factor'),
    [
        *((60, skew, seed, PERIOD_S, FIRST_MS, 1) for skew in SKEWS for seed in range(3)),
        *((90, skew, 0, SLOW_PERIOD_S, FIRST_MS, 3) for skew in SKEWS),
        # The worst that are believed.
        *(
            (150, skew, 0, PERIOD_S, 1000 * MAX_SKEW + FIRST_MS, 1)
            for skew in (-MAX_SKEW, MAX_SKEW)
        ),
    ],
)
def test_stamps_settle_on_the_true_time(
    length_s: float, skew: float, seed: int, period_s: float, first_ms: float, factor: float
) -> None:
    later = (2, 10, factor * SECONDS_2_TO_10_MS), (10, inf, factor * LATER_MS)
    check(simulate(length_s, skew, seed, period_s), (0, 2, first_ms), *later)


@pytest.mark.parametrize('skew', [-0.1, -0.06, 0.06, 0.1])
def test_an_unbelievable_clock_makes_errors_that_stay_bounded(skew: float) -> None:
    run = simulate(150, skew)
    clock_map = ClockMap(LEAST_DELAY_S)
    assert worst(errors_ms(run, map_all(clock_map, run))) < 500
    if abs(skew) == 0.1:
        assert clock_map.restarts > 10


@skews
def test_skew_is_learned(skew: float) -> None:
    run = simulate(60, skew)
    clock_map = ClockMap()
    assert clock_map.skew == 0
    map_all(clock_map, run.only(run.at(0, 0.9)))
    assert clock_map.skew == 0
    map_all(clock_map, run.only(run.at(0.9)))
    assert clock_map.skew == pytest.approx(1 / (1 + skew) - 1, abs=5e-6)


def test_a_constant_delay_is_taken_off_exactly_and_late_frames_move_no_stamp() -> None:
    run = simulate(5)
    run = replace(run, arrival_ns=START_NS + 1000 * run.sensor_us)
    stamps_ns = map_all(ClockMap(0.25), run)
    np.testing.assert_array_equal(stamps_ns, run.arrival_ns - 250_000_000)
    run = simulate(150, period_s=SLOW_PERIOD_S)
    true_ns = START_NS + 1000 * run.sensor_us
    late_ns = np.where(np.arange(len(true_ns)) % 10 == 9, 30_000_000, 0)
    stamps_ns = map_all(ClockMap(), replace(run, arrival_ns=true_ns + late_ns))
    np.testing.assert_array_equal(stamps_ns, true_ns)


@skews
@pytest.mark.parametrize('off_s', [0.0, 2.0])
def test_a_sensor_that_restarts(skew: float, off_s: float) -> None:
    run = simulate(60, skew)
    anew = run.at(30 + off_s)
    sensor_us = np.where(anew, run.sensor_us - run.sensor_us[anew][0], run.sensor_us)
    run = replace(run, sensor_us=sensor_us).only(run.at(0, 30) | anew)
    after = (30, 32 + off_s, FIRST_MS), (32 + off_s, inf, SECONDS_2_TO_10_MS)
    check(run, (10, 30, LATER_MS), *after, restarts=1)


def test_frames_that_arrive_together_keep_their_distance() -> None:
    run = simulate(10)
    # Every second frame waits for the next.
    together = replace(run, arrival_ns=np.repeat(run.arrival_ns[1::2], 2))
    check(together, (2, inf, SECONDS_2_TO_10_MS))


def test_a_counter_of_32_bits_that_wraps() -> None:
    run = simulate(60, 0.01)
    run = replace(run, sensor_us=(run.sensor_us + 2**32 - 35_000_000) % 2**32)
    assert run.sensor_us[0] > run.sensor_us[-1]
    check(run, (0, 10, FIRST_MS), (10, inf, SECONDS_2_TO_10_MS))


def test_a_clock_that_wrapped_may_be_restarted_and_wrap_again_or_stand_still() -> None:
    top = 2**32
    for sensor_us in ([top - 2_000_000, top - 1_000_000, 0, 1_000_000, 0, 1_000_000], [5, 5]):
        clock_map = ClockMap()
        arrivals = [START_NS + second * 10**9 for second in range(len(sensor_us))]
        assert [clock_map.map(*pair) for pair in zip(sensor_us, arrivals, strict=True)] == arrivals
        assert clock_map.restarts == 1


@skews
@pytest.mark.parametrize(
    ('step_s', 'after_s'), [(-3.0, 0), (-0.2, 0), (-0.05, 0), (3.0, 0), (0.2, 1.1), (0.9, 1.1)]
)
def test_a_host_clock_that_is_set_is_followed(skew: float, step_s: float, after_s: float) -> None:
    spans = [(0, 30, FIRST_MS), (30 + after_s, inf, FIRST_MS)]
    spans += [(34 if after_s else 32, inf, SECONDS_2_TO_10_MS)]
    if after_s:
        spans += [(30, 30 + after_s, 1000 * step_s + FIRST_MS)]
    check(simulate(60, skew).host_set(30, step_s), *spans, restarts=1, set_back=step_s < 0)


def test_the_smallest_steps_forward_are_mended_by_the_window() -> None:
    run = simulate(180, 0.003).host_set(60, 0.08)
    check(run, (0, inf, 80 + LATER_MS), (60 + WINDOW_S, inf, 3))


@skews
@pytest.mark.parametrize(
    ('length_s', 'first_ms', 'later_ms'), [(10, LATER_MS, LATER_MS), (100, 50.0, 2.0)]
)
def test_a_pulled_cable(skew: float, length_s: float, first_ms: float, later_ms: float) -> None:
    run = simulate(length_s + 120, skew).stalled(60 + length_s, 0.06)
    run = run.only(run.at(0, 60) | run.at(60 + length_s))
    assert run.arrival_ns[run.at(60)][0] - run.host_ns[run.at(60)][0] > 30_000_000
    check(run, (60, 61 + length_s, first_ms), (61 + length_s, inf, later_ms))


@skews
@pytest.mark.parametrize('length_s', [0.1, 0.5, 0.9])
def test_a_stall_of_the_transport_moves_no_stamp(skew: float, length_s: float) -> None:
    run = simulate(60, skew).stalled(30, length_s)
    late_s = (run.arrival_ns - run.host_ns).max() * 1e-9
    assert late_s == pytest.approx(length_s, abs=0.05)
    check(run, (10, inf, LATER_MS))


def test_a_long_stall_is_mended_when_it_ends() -> None:
    run, clock_map = simulate(60).stalled(30, 3.0), ClockMap(LEAST_DELAY_S)
    errors = errors_ms(run, map_all(clock_map, run))
    assert clock_map.restarts >= 1
    assert worst(errors[run.at(33, 35)]) < FIRST_MS
    assert worst(errors[run.at(35)]) < SECONDS_2_TO_10_MS


@pytest.mark.parametrize('length_s', [0.5, 2.5])
def test_a_backlog_at_the_start(length_s: float) -> None:
    """The map starts again when frames of more than a second arrive at one time."""
    run = simulate(30, 0.01).stalled(-1, 1 + length_s)
    shared = int((run.arrival_ns == run.arrival_ns[0]).sum())
    assert shared > 20
    stamps_ns = map_all(ClockMap(), run)
    assert (np.diff(stamps_ns) > 0).all()
    # All arrived at one time, and each stamp is a nanosecond later than the one before.
    assert (stamps_ns <= run.arrival_ns + shared).all()
    errors = errors_ms(run, stamps_ns) - 1000 * LEAST_DELAY_S
    assert worst(errors[run.at(length_s)]) < FIRST_MS
    assert worst(errors[run.at(length_s + 2.0)]) < SECONDS_2_TO_10_MS


def test_a_clock_that_drifts_is_followed() -> None:
    def warming_and_cooling(true_s: Floats) -> Floats:
        """Swing by 1000 ppm in ten minutes."""
        radians = 2 * np.pi * true_s / 600
        return 1e-3 * 600 / (2 * np.pi) * (1 - np.cos(radians))

    run = simulate(1200, period_s=SLOW_PERIOD_S, sensor_error_s=warming_and_cooling)
    check(run, (2, inf, 8))


def test_the_worst_drift_needs_no_more_memory_than_the_window() -> None:
    run = simulate(300, period_s=SLOW_PERIOD_S)
    sensor_s = run.sensor_us * 1e-6
    # It loses 5 ppm a second, and nothing delays frames, so each pair is a corner of the hull.
    arrival_s = sensor_s + 2.5e-6 * sensor_s**2
    run = replace(run, arrival_ns=START_NS + np.rint(arrival_s * 1e9).astype(np.int64))
    clock_map = ClockMap()
    map_all(clock_map, run.only(run.at(0, 100)))
    size = len(pickle.dumps(clock_map))
    assert size > 10 * WINDOW_S / SLOW_PERIOD_S
    map_all(clock_map, run.only(run.at(100)))
    assert len(pickle.dumps(clock_map)) < 1.05 * size


# Mostly frames as they come, and now and then anything.
steps = st.lists(
    st.tuples(
        st.integers(1, 100_000) | st.integers(-(2**40), 2**40),
        st.integers(0, 100_000_000) | st.integers(-(2**45), 2**45),
    ),
    min_size=1,
    max_size=40,
)
Pairs = list[tuple[int, int]]


def pairs_of(moves: Pairs) -> Pairs:
    """Return sensor times [µs] and arrivals [ns] that follow one another by `moves`."""
    sensor_us, arrival_ns = np.cumsum([(2**48, START_NS), *moves], axis=0, dtype=np.int64).T
    return list(zip(sensor_us.tolist(), arrival_ns.tolist(), strict=True))


def outcome(pairs: Pairs, min_delay_s: float = 0.0) -> tuple[list[int], list[int], list[float]]:
    """Return stamps, restarts and skews after each pair."""
    clock_map = ClockMap(min_delay_s)
    results = [(clock_map.map(*pair), clock_map.restarts, clock_map.skew) for pair in pairs]
    stamps_ns, restarts, rates = zip(*results, strict=True)
    return list(stamps_ns), list(restarts), list(rates)


@given(steps, st.integers(-(2**47), 2**62), st.integers(-START_NS, 2**62), st.integers(0, 1000))
def test_all_count_from_anywhere(moves: Pairs, shift_us: int, shift_ns: int, delay_ms: int) -> None:
    pairs = pairs_of(moves)
    stamps_ns, *rest = outcome(pairs)
    for shifted, later_ns in (
        (outcome([(sensor + shift_us, arrival) for sensor, arrival in pairs]), 0),
        (outcome([(sensor, arrival + shift_ns) for sensor, arrival in pairs]), shift_ns),
        (outcome(pairs, delay_ms / 1000), -delay_ms * 1_000_000),
    ):
        assert shifted == ([stamp + later_ns for stamp in stamps_ns], *rest)


@given(steps)
def test_stamps_rise_and_stay_before_arrivals_whatever_comes(moves: Pairs) -> None:
    pairs = pairs_of(moves)
    stamps_ns, restarts, _ = outcome(pairs)
    assert stamps_ns[0] == pairs[0][1]
    for index in range(1, len(pairs)):
        arrival_ns, last_ns = pairs[index][1], stamps_ns[index - 1]
        if restarts[index] > restarts[index - 1]:
            has_risen = arrival_ns >= pairs[index - 1][1]
            assert stamps_ns[index] == (max(arrival_ns, last_ns + 1) if has_risen else arrival_ns)
        else:
            assert last_ns < stamps_ns[index] <= max(arrival_ns, last_ns + 1)
