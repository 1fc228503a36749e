# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.experiments import marker
from retrolidar_ros.marker.battery import CELL_MAH, PROTOTYPE, Currents, active_share, drawn, life_h

SHARES = st.floats(0, 1)
CURRENTS = st.builds(
    Currents, sleep=st.floats(1e-4, 0.01), detection=st.floats(0.02, 10), active=st.floats(0.5, 50)
)
MONTH_H, YEAR_H = 730.5, 8766.0


def life_at(queries: float, currents: Currents = PROTOTYPE) -> float:
    return life_h(CELL_MAH, drawn(active_share(queries), currents).total)


def test_two_months_hold() -> None:
    assert 2 < life_at(1) / MONTH_H < 3
    assert 2 < life_h(CELL_MAH, drawn(0.001).total) / MONTH_H < 3


def test_modes_are_weighed_by_their_time() -> None:
    # By hand: 1 % of 3.98 mA, 99 % of 1 µA, and 1.302 s of each hour with 12.7 mA.
    means = drawn(active_share(1))
    assert means.detection == pytest.approx(0.0398, rel=1e-3)
    assert means.sleep == pytest.approx(0.00099, rel=1e-3)
    assert means.active == pytest.approx(12.7 * 1.302 / 3600)
    assert drawn(1.0) == Currents(0, 0, 12.7)


def test_two_years_need_a_lower_active_current() -> None:
    rare = replace(PROTOTYPE, detection=0.1)
    assert life_at(1, rare) < 2 * YEAR_H
    assert life_at(1, replace(rare, active=0.1)) > 2 * YEAR_H
    assert life_h(CELL_MAH, 0.1) < life_at(1)  # a mean of 100 µA is worse than the prototype


@given(SHARES, SHARES, CURRENTS)
def test_life_falls_with_activity(first: float, second: float, currents: Currents) -> None:
    less, more = sorted((first, second))
    assert drawn(less, currents).total <= drawn(more, currents).total * (1 + 1e-12)


@given(SHARES, CURRENTS)
def test_the_mean_lies_between_the_modes(share: float, currents: Currents) -> None:
    assert currents.sleep <= drawn(share, currents).total <= currents.active * (1 + 1e-12)


@given(st.floats(0, 500), st.integers(1, 5))
def test_packets_count_as_queries_do(queries: float, packets: int) -> None:
    assert active_share(queries, packets) == pytest.approx(active_share(queries * packets))


@pytest.mark.parametrize('queries', [-1.0, 2766.0, float('nan'), float('inf')])
def test_impossible_queries_are_named(queries: float) -> None:
    with pytest.raises(
        ValueError, match=rf'^{queries:g} queries an hour are impossible; 0 to 2765'
    ):
        active_share(queries)


def test_lives_of_the_report() -> None:
    figures = marker.run(np.random.default_rng(1), quick=True)
    rare = replace(PROTOTYPE, detection=marker.OPTIMISED_MA)
    lasting_h = life_at(1, replace(rare, active=figures['two_years_active_ma']))
    assert lasting_h == pytest.approx(2 * YEAR_H)
    for lives_h in figures['over_queries_h'].values():
        assert (np.diff(lives_h) < 0).all()
    lives = [round(hours / 24) for hours in figures['once_an_hour_h'].values()]
    assert lives == [83, 570, 1851]
