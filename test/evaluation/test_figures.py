# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rates with their intervals, where they cross a level, and the verdicts beside the paper's."""

import math
from collections.abc import Callable

import pytest

from evaluation.bench.rates import crossing, falls_below, frequency, rate
from evaluation.report.claims import Claim
from evaluation.report.verdicts import (
    NOT_COMPARABLE,
    Said,
    above,
    below,
    exactly,
    judge,
    value_of,
    verdict,
)


@pytest.mark.parametrize(
    ('hits', 'low', 'high'),
    # Wilson intervals as R's prop.test(x, 10, correct = FALSE) gives them.
    [(0, 0.0, 0.2775), (5, 0.2366, 0.7634), (10, 0.7225, 1.0)],
)
def test_wilson_intervals_of_ten_trials(hits: int, low: float, high: float) -> None:
    measured = rate(hits, 10)
    assert measured['rate'] == hits / 10
    assert (measured['low'], measured['high']) == pytest.approx((low, high), abs=1e-4)


@pytest.mark.parametrize(
    ('events', 'low', 'high'),
    # Exact intervals of a Poisson count (Garwood 1936).
    [(0, 0.0, 3.6889), (1, 0.0253, 5.5716), (10, 4.7954, 18.3904), (100, 81.364, 121.627)],
)
def test_poisson_intervals(events: int, low: float, high: float) -> None:
    measured = frequency(events, 2.0)
    assert measured['per_hour'] == events / 2
    assert (measured['low'], measured['high']) == pytest.approx((low / 2, high / 2), abs=1e-3)


@pytest.mark.parametrize(
    ('count', 'of'), [(rate, (0, 0)), (rate, (6, 5)), (frequency, (-1, 1.0)), (frequency, (1, 0.0))]
)
def test_impossible_counts(count: Callable[..., object], of: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=r'trials|events'):
        count(*of)


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
    assert crossing(0.8, [1, 2], [rate(9, 10), rate(9, 10)])['at'] == 2
    assert crossing(0.8, [1, 2], [rate(1, 10), rate(0, 10)])['at'] is None
    assert many['high'] - many['low'] < few['high'] - few['low']  # type: ignore[operator]


@pytest.mark.parametrize(
    ('value', 'said', 'judged'),
    [
        (2.72, exactly(2.6, 'better'), 'same'),
        (2.88, exactly(2.6, 'better'), 'better'),
        (2.4, exactly(2.6, 'better'), 'worse'),
        (0.5, exactly(1, 'worse'), 'better'),
        (0.27, exactly(0.32), 'differs'),
        (-53, exactly(-85, 'worse'), 'worse'),
        (-87, exactly(-85, 'worse'), 'same'),
        (0.2, below(4), 'same'),
        (4.4, below(2), 'worse'),
        (1.76, above(1), 'same'),
    ],
)
def test_a_value_beside_the_papers(value: float, said: Said, judged: str) -> None:
    assert judge(value, said) == judged


def test_what_is_printed_is_judged() -> None:
    printed = {'2.88 m': 2.88, '-53%': -53, 'inf mm': math.inf, '1.6 years': 1.6 * 365.25}
    assert {text: value_of(text) for text in printed} == pytest.approx(printed)


def test_the_default_is_judged_unless_only_the_papers_method_does_it() -> None:
    assert verdict('reading sure', Claim('82%', '100%')) == 'same'
    assert verdict('reading found', Claim('56%', '97%')) == 'worse'
    assert verdict('reading wrong', Claim('18%', '0%')) == ''
    assert verdict('chain bits', Claim('0', '0')) == NOT_COMPARABLE
    assert verdict('reading reach', Claim()) == NOT_COMPARABLE
    with pytest.raises(ValueError, match='no value'):
        value_of('evidence decides')
