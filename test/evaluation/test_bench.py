# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest

from evaluation.bench.disturbances import BLOCK_FRAMES, FAMILY, Member
from evaluation.bench.rates import chance_of_fall, exact_frequency, rate
from evaluation.bench.setup import Setup
from evaluation.bench.stresses import STRESSES, Stress, record
from evaluation.bench.transmissions import transmission
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.reference import RESPONSE, SENSOR
from retrolidar_ros.scene.transmission import Transmission
from retrolidar_ros.sensor.frame import Status


@pytest.mark.parametrize('packets', [1, None])
def test_transmission_of_many_markers_is_that_of_each(packets: int | None) -> None:
    rng = np.random.default_rng(1)
    edges_s = 0.021 * np.arange(200)
    ids, start_s = rng.choice(USABLE_IDS, 4), rng.uniform(-1, 2, 4)
    bit_s = rng.uniform(0.041, 0.043, 4)
    sent = math.inf if packets is None else packets
    found = transmission(edges_s, ids, start_s, bit_s, RESPONSE, sent)
    for column, (identity, start, bit) in enumerate(zip(ids, start_s, bit_s, strict=True)):
        marker = Marker(
            int(identity),
            (0.0, 0.0, 1.0),
            'marker',
            bit_period_s=float(bit),
            start_s=float(start),
            packets=packets,
            response=RESPONSE,
        )
        expected = Transmission(marker).mean((edges_s[1:] + edges_s[:-1]) / 2, 0.021)
        np.testing.assert_allclose(found[:, column], expected, atol=1e-9)


@pytest.mark.parametrize('stress', STRESSES, ids=lambda stress: stress.name)
def test_a_stress_gives_the_same_possible_frames_again(stress: Stress) -> None:
    first, second = (record(stress, 150.0, np.random.default_rng(7), USABLE_IDS) for _ in range(2))
    np.testing.assert_array_equal(first.recording.signal, second.recording.signal)
    assert (first.recording.signal >= 0).all()
    assert (np.diff(first.recording.stamp_ns) > 0).all()
    assert len(set(first.ids.tolist())) == first.recording.grid.zones
    if first.seconds is not None:
        assert (first.seconds != first.ids).all()


@pytest.mark.parametrize('member', FAMILY, ids=lambda member: member.name)
def test_blocks_of_a_disturbance_follow_each_other(member: Member) -> None:
    duration_s = 2.5 * BLOCK_FRAMES * SENSOR.period_s
    blocks = list(member.blocks(duration_s, np.random.default_rng(3), SENSOR))
    sequence = np.concatenate([block.sequence for block in blocks])
    np.testing.assert_array_equal(sequence, np.arange(len(sequence)))
    assert len(sequence) == round(duration_s / SENSOR.period_s)
    for block in blocks:
        none = block.status == Status.NO_TARGET
        assert np.isfinite(block.signal).all()
        assert (np.isnan(block.distance) == none).all()


def test_bounds_of_a_poisson_count_are_exact() -> None:
    none, ten = exact_frequency(0, 2.0), exact_frequency(10, 1.0)
    assert none['low'] == 0
    assert none['high'] == pytest.approx(-math.log(0.025) / 2)
    assert (ten['low'], ten['high']) == pytest.approx((4.7954, 18.3904), abs=1e-3)


def test_chance_of_a_fall_is_that_of_fisher() -> None:
    assert chance_of_fall(rate(10, 10), rate(5, 10)) == pytest.approx(0.016254, rel=1e-4)
    assert chance_of_fall(rate(5, 10), rate(10, 10)) == pytest.approx(1)


def test_registered_ids_are_the_same_for_one_seed() -> None:
    ids = Setup(seed=4, registered=30).ids
    assert len(set(ids.tolist())) == 30
    np.testing.assert_array_equal(ids, Setup(seed=4, registered=30).ids)
