# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import pytest

from evaluation.bench.rates import falls_below, frequency, rate


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
    # Exact Poisson intervals (Garwood 1936), which Byar's come near to.
    [(0, 0.0, 3.689), (1, 0.0253, 5.572), (10, 4.795, 18.39), (100, 81.36, 121.63)],
)
def test_poisson_intervals(events: int, low: float, high: float) -> None:
    measured = frequency(events, 2.0)
    assert measured['per_hour'] == events / 2
    assert measured['low'] == pytest.approx(low / 2, rel=0.02, abs=0.01)
    assert measured['high'] == pytest.approx(high / 2, rel=0.02)


@pytest.mark.parametrize(('events', 'hours'), [(-1, 1.0), (1, 0.0), (1, -1.0)])
def test_no_frequency_of_impossible_counts(events: int, hours: float) -> None:
    with pytest.raises(ValueError, match='events'):
        frequency(events, hours)


def test_a_level_is_crossed_between_two_places() -> None:
    assert falls_below(0.8, [0, 10, 20], [1.0, 0.9, 0.5]) == pytest.approx(12.5)


def test_the_way_may_lead_down() -> None:
    assert falls_below(0.8, [20, 10, 0], [1.0, 1.0, 0.0]) == pytest.approx(8.0)


def test_the_first_crossing_counts() -> None:
    assert falls_below(0.8, [0, 1, 2, 3], [1.0, 0.6, 1.0, 0.0]) == pytest.approx(0.5)


def test_to_touch_the_level_is_not_to_fall_below() -> None:
    assert falls_below(0.8, [0, 1, 2], [1.0, 0.8, 1.0]) is None
    assert falls_below(0.8, [0, 1, 2], [1.0, 0.8, 0.7]) == pytest.approx(1.0)


@pytest.mark.parametrize('shares', [[0.7, 0.9, 0.5], [1.0, 0.9, 0.8], [0.7, 0.6, 0.5]])
def test_no_crossing(shares: list[float]) -> None:
    assert falls_below(0.8, [0, 1, 2], shares) is None
