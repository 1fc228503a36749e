# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from evaluation.bench.disturbances import MOST_SIGNAL, restless_blocks
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Recording, Status

DURATION_S = 600.0
TARGET = (Status.VALID, Status.NO_PREVIOUS_TARGET)


@pytest.fixture(scope='module')
def blocks() -> list[Recording]:
    return list(restless_blocks(DURATION_S, np.random.default_rng(0)))


def joined(blocks: list[Recording], field: str) -> NDArray[Any]:
    return np.concatenate([getattr(block, field) for block in blocks])


def test_steps_of_the_signal_are_those_of_a_moving_hand(blocks: list[Recording]) -> None:
    signal = joined(blocks, 'signal').astype(np.float64)
    seen = np.isin(joined(blocks, 'status'), TARGET) & (signal > 0)
    both = seen[1:] & seen[:-1]
    ratios = np.abs(np.log(signal[1:][both] / signal[:-1][both]))
    quantiles = np.quantile(ratios, [0.5, 0.9, 0.99, 0.999])
    assert quantiles == pytest.approx([0.10, 0.41, 1.40, 3.08], rel=0.15)


def test_signals_are_those_of_walls_and_hands(blocks: list[Recording]) -> None:
    signal = joined(blocks, 'signal')
    seen = signal[np.isin(joined(blocks, 'status'), TARGET)]
    low, middle, high = np.quantile(seen, [0.02, 0.5, 0.98])
    assert low < 8
    assert 80 < middle < 250
    assert high > 1000
    assert seen.max() < MOST_SIGNAL * 1.1


def test_targets_vanish_and_come_back(blocks: list[Recording]) -> None:
    lost_of = kept_of = back_of = gone_of = 0
    for block in blocks:
        seen = np.isin(block.status, TARGET)
        seen = seen[:, seen.any(axis=0)]
        lost_of += np.count_nonzero(seen[:-1] & ~seen[1:])
        kept_of += np.count_nonzero(seen[:-1])
        back_of += np.count_nonzero(~seen[:-1] & seen[1:])
        gone_of += np.count_nonzero(~seen[:-1])
    assert lost_of / kept_of == pytest.approx(0.04, rel=0.05)
    assert back_of / gone_of == pytest.approx(0.12, rel=0.05)


def test_statuses_tell_why(blocks: list[Recording]) -> None:
    status = joined(blocks, 'status')
    codes, counts = np.unique(status, return_counts=True)
    assert codes.tolist() == [4, Status.VALID, Status.SIGNAL_TOO_LOW, 10, Status.NO_TARGET]
    invalid = counts[[0, 2, 4]]
    assert invalid[2] > 0.75 * invalid.sum()
    nothing = status == Status.NO_TARGET
    assert (joined(blocks, 'signal')[nothing] == 0).all()
    assert (np.isnan(joined(blocks, 'distance')) == nothing).all()


def test_some_zones_see_nothing_for_a_while(blocks: list[Recording]) -> None:
    empty = [~block.signal.any(axis=0) for block in blocks]
    assert np.mean(empty) == pytest.approx(0.1, abs=0.06)


def test_distance_goes_with_the_signal(blocks: list[Recording]) -> None:
    signal, distance = joined(blocks, 'signal'), joined(blocks, 'distance')
    near = (signal > 1000) & (joined(blocks, 'status') == Status.VALID)
    assert distance[near] == pytest.approx(0.2 * np.sqrt(1700 / signal[near]), rel=0.15)


def test_frames_follow_each_other_and_are_as_many_as_asked(blocks: list[Recording]) -> None:
    assert (np.diff(joined(blocks, 'sequence')) == 1).all()
    assert np.diff(joined(blocks, 'stamp_ns')) == pytest.approx(21e6)
    assert sum(map(len, blocks)) == round(DURATION_S / SENSOR.period_s)
    assert [len(block) for block in restless_blocks(0.5, np.random.default_rng(0))] == [24]


def test_a_seed_gives_one_stream_and_another_seed_another() -> None:
    first, again, other = (
        next(restless_blocks(10, np.random.default_rng(seed))).signal for seed in (1, 1, 2)
    )
    assert (first == again).all()
    assert (first != other).mean() > 0.5
