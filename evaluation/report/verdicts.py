# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Verdicts on the items of the paper: its value against the one we print, by one rule for all.

What is printed is what is judged, so that a reader can check each row. A value is the same as the
paper's if it is within `TOLERANCE` of it, or keeps to a bound; else it is better or worse, or
differs where neither more nor less is better.
"""

import math
import re
from typing import NamedTuple

from evaluation.report.claims import NOT_READ, NOTHING, UNSURE, Claim

TOLERANCE = 0.05
NOT_COMPARABLE = 'not comparable'
_UNITS = {'years': 365.25, 'months': 365.25 / 12}  # in days; of all else the unit is the paper's


class Said(NamedTuple):
    """What the paper says of an item, in the unit of the printed value."""

    low: float
    high: float
    more_is: str = ''  # better, worse, or neither
    by_method: bool = False  # whether the value is of method `paper`, as the default has none


def exactly(value: float, more_is: str = '', *, by_method: bool = False) -> Said:
    """Return that the paper gives one value."""
    return Said(value, value, more_is, by_method)


def above(value: float) -> Said:
    """Return that the paper says more than a value, and more is better."""
    return Said(value, math.inf, 'better')


def below(value: float, more_is: str = 'worse', *, by_method: bool = False) -> Said:
    """Return that the paper says less than a value."""
    return Said(0.0, value, more_is, by_method)


SAID: dict[str, Said | str] = {
    'ids ids': exactly(4096, 'better'),
    'marker two-months': exactly(2 * _UNITS['months'], 'better'),
    'marker two-years': above(2 * _UNITS['years']),
    'marker cheap-looks': above(2 * _UNITS['years']),
    'marker active': '',
    'reading reach': exactly(2.6, 'better'),
    'reading sure': exactly(100, 'better'),
    'reading found': exactly(100, 'better', by_method=True),
    'reading wrong': '',
    'reach three': above(99),
    'angle angle': exactly(25, 'better'),
    'roc preambles': exactly(0.5, 'worse', by_method=True),
    'roc silent': exactly(0, 'worse'),
    'ids random': below(1, by_method=True),  # negligible
    'ranging near': below(2),
    'ranging far': below(2.5),
    'ranging board': exactly(1, 'worse'),
    'several mean': exactly(92.5, 'better'),
    'several worst': exactly(85, 'better'),
    'peers tag-3': Said(2.2, 2.4, 'better'),
    'peers tag-1': below(0.9, 'better'),
    'peers gain': exactly(44, 'better'),
    'peers near': below(4),
    'peers far': exactly(11.7, 'worse'),
    'peers worst': exactly(156, 'worse'),
    'peers above': exactly(36, 'worse'),
    'peers less': exactly(-85, 'worse'),
    'peers qr': below(1, 'better'),
    'reach small': exactly(1.3, 'better'),
    'peers power': exactly(0.32),
    'peers yaw': Said(45, 55, 'better'),  # about 50
    'ambient loss': Said(0.15, 0.25, 'worse'),  # about 0.2
    'ambient outdoors': above(1),
    'reading clean': exactly(89, by_method=True),
    'reading broken': exactly(48, by_method=True),
    'marker powers': exactly(32.4),
    'marker voltages': exactly(32.4),
    'marker outdoors': NOT_COMPARABLE,
    'marker guard': exactly(1, 'worse'),
    'marker woken': '',
    'marker narrow': NOT_COMPARABLE,  # a bound beside what was tried
    'coffee task': exactly(5.3, 'worse'),
    'coffee tags': exactly(8.1, 'worse'),
    'coffee range': below(10),  # millimetres
    'drone alive': exactly(91, 'better'),
    'drone falls': '',
    'drone range': exactly(100, 'better'),
    'place range': NOT_COMPARABLE,  # a range beside positions
}


def value_of(text: str) -> float:
    """Return the first number of a printed value, a length of time in days; ValueError: none."""
    found = re.match(r'(?:[≥≤] )?([+-]?(?:[\d.]+|inf)) ?(\w*)', text)
    if found is None:
        raise ValueError(f'{text!r} has no value to judge')
    return float(found[1]) * _UNITS.get(found[2], 1.0)


def judge(value: float, said: Said) -> str:
    """Return whether a value is the same as what the paper says, better, worse, or differs."""
    low, high = said.low - TOLERANCE * abs(said.low), said.high + TOLERANCE * abs(said.high)
    if low <= value <= high:
        return 'same'
    if not said.more_is:
        return 'differs'
    return 'better' if (value > high) == (said.more_is == 'better') else 'worse'


def verdict(item: str, claim: Claim) -> str:
    """Return the verdict on an item, by the default's value unless only `paper` has one."""
    said = SAID[item]
    if isinstance(said, str):
        return said
    text = claim.method if said.by_method else claim.default
    return NOT_COMPARABLE if text in (NOTHING, NOT_READ, UNSURE) else judge(value_of(text), said)


def cells(item: str, claim: Claim) -> str:
    """Return the cells of the report's table of the paper: both values, and the verdict."""
    return f'{claim.method} | {claim.default} | {verdict(item, claim)}'
