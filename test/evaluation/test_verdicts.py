# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The verdicts on the items of the paper."""

import math

import pytest

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
    ('value', 'said', 'judged'),
    [
        (2.72, exactly(2.6, 'better'), 'same'),
        (2.88, exactly(2.6, 'better'), 'better'),
        (2.4, exactly(2.6, 'better'), 'worse'),
        (5.3, exactly(1, 'worse'), 'worse'),
        (0.5, exactly(1, 'worse'), 'better'),
        (0.27, exactly(0.32), 'differs'),
        (-53, exactly(-85, 'worse'), 'worse'),
        (-87, exactly(-85, 'worse'), 'same'),
        (0, exactly(0, 'worse'), 'same'),
        (1, exactly(0, 'worse'), 'worse'),
        (0.2, below(4), 'same'),
        (4.4, below(2), 'worse'),
        (0.99, below(0.9, 'better'), 'better'),
        (1.76, above(1), 'same'),
        (0.9, above(1), 'worse'),
        (3.12, Said(2.2, 2.4, 'better'), 'better'),
    ],
)
def test_a_value_beside_the_papers(value: float, said: Said, judged: str) -> None:
    assert judge(value, said) == judged


@pytest.mark.parametrize(
    ('text', 'value'),
    [
        ('2.88 m', 2.88),
        ('82%', 82),
        ('-53%', -53),
        ('inf mm', math.inf),
        ('1.6 years', 1.6 * 365.25),
    ],
)
def test_what_is_printed_is_judged(text: str, value: float) -> None:
    assert math.isclose(value_of(text), value)


def test_the_default_is_judged_unless_only_the_papers_method_does_it() -> None:
    assert verdict('reading sure', Claim('82%', '100%')) == 'same'
    assert verdict('reading found', Claim('56%', '97%')) == 'worse'
    assert verdict('reading wrong', Claim('18%', '0%')) == ''
    assert verdict('chain bits', Claim('0', '0')) == NOT_COMPARABLE
    assert verdict('reading reach', Claim()) == NOT_COMPARABLE
    with pytest.raises(ValueError, match='no value'):
        value_of('evidence decides')
