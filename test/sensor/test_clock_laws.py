# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stamps rise and stay before arrivals, wherever clocks begin and whatever they do."""

import numpy as np
from harness_clock import (
    START_NS,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from retrolidar_ros.sensor.clock import ClockMap

law = settings(derandomize=True, deadline=None, max_examples=60)


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
    sensor_us, arrival_ns = np.cumsum(
        np.array([(2**48, START_NS), *moves], dtype=np.int64), axis=0
    ).T
    return list(zip(sensor_us.tolist(), arrival_ns.tolist(), strict=True))


def outcome(pairs: Pairs, min_delay_s: float = 0.0) -> tuple[list[int], list[int], list[float]]:
    """Return stamps, restarts and skews after each pair."""
    clock_map = ClockMap(min_delay_s)
    results = [(clock_map.map(*pair), clock_map.restarts, clock_map.skew) for pair in pairs]
    stamps_ns, restarts, rates = zip(*results, strict=True)
    return list(stamps_ns), list(restarts), list(rates)


@law
@given(steps, st.integers(-(2**47), 2**62), st.integers(-START_NS, 2**62), st.integers(0, 1000))
def test_all_may_count_from_anywhere(
    moves: Pairs, shift_us: int, shift_ns: int, delay_ms: int
) -> None:
    pairs = pairs_of(moves)
    stamps_ns, *rest = outcome(pairs)
    for shifted, later_ns in (
        (outcome([(sensor + shift_us, arrival) for sensor, arrival in pairs]), 0),
        (outcome([(sensor, arrival + shift_ns) for sensor, arrival in pairs]), shift_ns),
        (outcome(pairs, delay_ms / 1000), -delay_ms * 1_000_000),
    ):
        assert shifted == ([stamp + later_ns for stamp in stamps_ns], *rest)


@law
@given(steps)
def test_stamps_rise_and_stay_before_arrivals_whatever_comes(moves: Pairs) -> None:
    pairs = pairs_of(moves)
    stamps_ns, restarts, _ = outcome(pairs)
    assert stamps_ns[0] == pairs[0][1]
    for index in range(1, len(pairs)):
        arrival_ns, last_ns = pairs[index][1], stamps_ns[index - 1]
        if restarts[index] > restarts[index - 1]:
            assert stamps_ns[index] == arrival_ns
        else:
            assert last_ns < stamps_ns[index] <= max(arrival_ns, last_ns + 1)
