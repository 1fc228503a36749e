# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from harness_detector import ID, repeating

from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.parameters import defaults

FRAMES = list(repeating(6.0))


def detect(min_readings: int) -> tuple[list[Detection], list[str]]:
    decoding = Decoding({**defaults(), 'min_readings': min_readings})
    found = list(decoding.detect(FRAMES))
    return found, [str(one) for one in decoding.explanation().findings()]


READING = detect(1)[0][0]


def reading(at_s: float, range_m: float = 1.0, identity: int = ID) -> Detection:
    place = replace(READING.place, range_m=range_m, range_stddev_m=0.002)
    return replace(READING, id=identity, stamp_ns=round(at_s * 1e9), place=place)


@pytest.mark.parametrize('min_readings', [1, 2, 3])
def test_the_first_readings_of_a_marker_are_withheld_and_the_rest_are_the_same(
    min_readings: int,
) -> None:
    every, _ = detect(1)
    found, why = detect(min_readings)
    assert [one.stamp_ns for one in found] == [one.stamp_ns for one in every[min_readings - 1 :]]
    assert why == []


def test_who_is_never_read_often_enough_is_told_why() -> None:
    found, why = detect(20)
    assert found == []
    assert any('withheld: fewer agree than min_readings, 20' in one for one in why)


@pytest.mark.parametrize(
    ('second', 'agrees'),
    [
        (reading(1.3), True),
        (reading(1.3, 1.5), True),  # it comes nearer, or goes
        (reading(1.3, 2.5), False),
        (reading(0.0, 1.05), False),
        (reading(15.0), True),  # read in few of its packets
        (reading(17.0), False),
        (reading(1.3, identity=2096), False),
        (reading(-1e4), False),  # the clock was set back
    ],
)
def test_two_readings_agree_in_id_time_and_range(second: Detection, agrees: bool) -> None:
    agreement = Agreement(2)
    assert agreement.confirmed([reading(0.0)]) == []
    assert agreement.confirmed([second]) == ([second] if agrees else [])
    assert (agreement.passed, agreement.withheld) == (agrees, 2 - agrees)


def test_rare_chance_readings_never_pass() -> None:
    """At a hundred times the default rate, of 4094 IDs, for three days."""
    rng = np.random.default_rng(1)
    agreement = Agreement(2)
    at_s = np.sort(rng.uniform(0, 72 * 3600, 720))
    rows = zip(at_s, rng.uniform(0.3, 4, 720), rng.integers(1, 4095, 720), strict=True)
    passed = [agreement.confirmed([reading(*row)]) for row in rows]
    assert sum(map(len, passed)) == 0


def test_a_marker_is_followed_once_a_reading_of_it_was_passed_on() -> None:
    found = {}
    for min_readings in (1, 2):
        decoding = Decoding({**defaults(), 'min_readings': min_readings})
        found[min_readings] = list(decoding.follow(FRAMES))
    second = detect(2)[0][0]
    assert found[2]
    assert min(one.stamp_ns for one in found[2]) >= second.end_ns
    assert min(one.stamp_ns for one in found[1]) < second.end_ns
