# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which readings a task takes of a marker that is read at every frame, and of more than it can."""

from __future__ import annotations

import numpy as np
import pytest
from harness_readings import HERE, SQUARE, seen

from retrolidar_ros.tasks.backlog import Backlog
from retrolidar_ros.tasks.resting import FIRST_S, NEW, Resting

STEP_S = 0.02


def taken(stamps_s: list[float], first_s: float = 0.0, speed_m_s: float = 0.0) -> list[float]:
    resting = Resting()
    return [at for at in stamps_s if resting.is_due('one', at, first_s, speed_m_s)]


def test_readings_of_a_track_become_rarer() -> None:
    stamps_s = np.arange(0.0, 20.0, STEP_S).tolist()
    assert taken(stamps_s) == pytest.approx([1.0, 2.0, 4.0, 8.0, 16.0], abs=0.1)


def test_their_mean_is_as_exact_as_they_say() -> None:
    rng = np.random.default_rng(5600)
    stamps_s = np.arange(0.0, 60.0, STEP_S)
    rows = np.searchsorted(stamps_s, taken(stamps_s.tolist()))
    pulls = []
    for _ in range(300):
        means = np.cumsum(rng.standard_normal(len(stamps_s))) / np.arange(1, len(stamps_s) + 1)
        weights = (1 + rows) / NEW**2
        pulls.append(np.sum(weights * means[rows]) / np.sqrt(weights.sum()))
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.2


def test_nothing_is_taken_of_what_moves_and_what_stops_begins_anew() -> None:
    resting = Resting()
    stamps_s = np.arange(0.0, 40.0, STEP_S).tolist()

    def due(at: float) -> bool:
        return resting.is_due('one', at, 0.0, 0.1 if 10.0 < at < 20.0 else 0.001)

    found = [at for at in stamps_s if due(at)]
    assert not [at for at in found if 10.0 < at < 20.0 + FIRST_S - STEP_S]
    assert [at for at in found if at > 20.0] == pytest.approx([21, 22, 24, 28, 36], abs=0.2)


def test_a_new_track_and_a_jump_of_time_begin_anew() -> None:
    resting = Resting()
    assert resting.is_due('one', 100.0, 90.0, 0.0)
    assert not resting.is_due('one', 105.0, 90.0, 0.0)
    assert resting.is_due('one', 106.5, 105.0, 0.0)
    assert not resting.is_due('one', 10.0, 9.0, 0.0)
    assert resting.is_due('one', 11.5, 9.0, 0.0)
    assert resting.is_due('other', 11.5, 9.0, 0.0)


def test_who_waits_longest_is_next_with_the_newest_of_its_readings() -> None:
    rng = np.random.default_rng(1)
    backlog = Backlog()
    for index in range(30):
        for name in ('mug', 'jar')[index > 0 :]:
            backlog.add(name, seen(HERE, SQUARE[0], rng, stamp_s=index), now_s=0.1 * index)
    assert backlog.dropped == 22
    assert len(backlog) == 9
    mug, jar = backlog.pop(), backlog.pop()
    assert (mug.name, [one.stamp_s for one in mug.readings]) == ('mug', [0])
    assert (jar.name, [one.stamp_s for one in jar.readings]) == ('jar', list(range(22, 30)))
    assert jar.since_s == 0.0
    assert not backlog
