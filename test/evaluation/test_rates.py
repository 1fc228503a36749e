# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math

import pytest

from evaluation.bench.rates import crossing, falls_below, frequency, rate


@pytest.mark.parametrize(
    ('hits', 'low', 'high'),
    # Wilson intervals as R's prop.test(x, 10, correct = FALSE) gives them.
    [(0, 0.0, 0.2775), (5, 0.2366, 0.7634), (10, 0.7225, 1.0)],
)
def test_wilson_intervals_of_ten_trials(hits: int, low: float, high: float) -> None:
    measured = rate(hits, 10)
    assert measured['rate'] == hits / 10
    assert (measured['low'], measured['high']) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(('hits', 'trials'), [(0, 0), (-1, 5), (6, 5)])
def test_no_rate_of_impossible_counts(hits: int, trials: int) -> None:
    with pytest.raises(ValueError, match='trials'):
        rate(hits, trials)


@pytest.mark.parametrize(
    ('events', 'low', 'high'),
    # Exact intervals of a Poisson count (Garwood 1936).
    [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (10, 4.7954, 18.3904), (100, 81.364, 121.627)],
)
def test_poisson_intervals(events: int, low: float, high: float) -> None:
    measured = frequency(events, 2.0)
    assert measured['per_hour'] == events / 2
    assert (measured['low'], measured['high']) == pytest.approx((low / 2, high / 2), abs=1e-3)


@pytest.mark.parametrize(('events', 'hours'), [(-1, 1.0), (1, 0.0), (1, -1.0)])
def test_no_frequency_of_impossible_counts(events: int, hours: float) -> None:
    with pytest.raises(ValueError, match='events'):
        frequency(events, hours)


def test_none_seen_bounds_the_frequency() -> None:
    assert frequency(0, 2.0)['high'] == pytest.approx(-math.log(0.025) / 2)


def test_a_level_is_crossed_between_two_places() -> None:
    assert falls_below(0.8, [0, 10, 20], [1.0, 0.9, 0.5]) == pytest.approx(12.5)
    assert falls_below(0.8, [20, 10, 0], [1.0, 1.0, 0.0]) == pytest.approx(8.0)
    assert falls_below(0.8, [0, 1, 2, 3], [1.0, 0.6, 1.0, 0.0]) == pytest.approx(0.5)
    assert falls_below(0.8, [0, 1, 2], [1.0, 0.8, 1.0]) == 2
    assert falls_below(0.8, [0, 1, 2], [0.7, 0.9, 0.5]) is None


def test_a_crossing_has_bounds_that_shrink_with_trials() -> None:
    few, many = (
        crossing(0.8, [1, 2, 3], [rate(n, n), rate(n * 9 // 10, n), rate(n // 10, n)])
        for n in (20, 2000)
    )
    for found in (few, many):
        assert found['low'] is not None
        assert found['high'] is not None
        assert found['low'] <= 2.125 <= found['high']
        assert found['at'] == pytest.approx(2.125, abs=0.01)
    assert many['high'] - many['low'] < few['high'] - few['low']  # type: ignore[operator]


def test_a_crossing_beyond_the_ends() -> None:
    assert crossing(0.8, [1, 2], [rate(9, 10), rate(9, 10)])['at'] == 2
    assert crossing(0.8, [1, 2], [rate(1, 10), rate(0, 10)])['at'] is None
