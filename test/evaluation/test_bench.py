# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What experiments are made of: recordings, disturbances, times."""

from dataclasses import replace

import numpy as np
import pytest

from evaluation.bench.disturbances import BLOCK_FRAMES, FAMILY, Member
from evaluation.bench.judging import BOTH, judged
from evaluation.bench.recordings import SILENCE_BITS, record
from evaluation.bench.stresses import PLAIN, STRESSES, Stress
from evaluation.experiments import time_to_id
from evaluation.experiments.moving import across
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.model import Status


@pytest.mark.parametrize('stress', STRESSES, ids=lambda stress: stress.name)
def test_a_stress_gives_the_same_possible_frames_again(stress: Stress) -> None:
    first, second = (record(stress, 150.0, np.random.default_rng(7)) for _ in range(2))
    np.testing.assert_array_equal(first.recording.signal, second.recording.signal)
    assert (first.recording.signal >= 0).all()
    assert (np.diff(first.recording.stamp_ns) > 0).all()
    assert len(set(first.ids.tolist())) == first.recording.grid.zones
    if first.seconds is not None:
        assert (first.seconds != first.ids).all()


def test_lone_packets_come_after_silence_and_end_before_the_recording() -> None:
    sent = record(PLAIN, 600.0, np.random.default_rng(0))
    assert sent.start_s.min() >= SILENCE_BITS * BIT_PERIOD_S
    time_s, dark = sent.recording.stamp_ns * 1e-9, sent.recording.signal < WALL_SIGNAL + 300
    ends_s = np.array([time_s[dark[:, zone]][[0, -1]] for zone in range(16)])
    assert ends_s[:, 0] == pytest.approx(sent.start_s, abs=0.022)
    assert (ends_s[:, 1] <= sent.start_s + PACKET_BITS * BIT_PERIOD_S + 0.011).all()


def test_a_hand_hides_the_middle_of_the_packet_and_a_far_wall_its_dark_bits() -> None:
    hand = record(replace(PLAIN, hand_s=0.3), 150.0, np.random.default_rng(0))
    near = hand.recording.distance < 0.3
    middles_s = [hand.recording.stamp_ns[near[:, zone]].mean() * 1e-9 for zone in range(16)]
    assert middles_s == pytest.approx(hand.start_s + hand.packet_s / 2, abs=0.02)
    assert near.sum(axis=0) * 0.021 == pytest.approx(np.full(16, 0.3), abs=0.05)
    wall = record(replace(PLAIN, far_wall=0.5), 150.0, np.random.default_rng(0))
    assert wall.recording.signal.min(axis=0) == pytest.approx(np.full(16, 77.0), abs=25)


def test_a_marker_on_its_way_is_in_one_zone_after_the_other() -> None:
    rng = np.random.default_rng(3)
    path = across(0.4, 1.0, rng)
    sent = record(PLAIN, 360.0, rng, range_m=1.0, repeated_s=8.0, path=path)
    speeds = np.abs(np.diff(path(np.arange(0, 8, 0.01))[:, 0])) / 0.01
    assert np.median(speeds) == pytest.approx(0.4)
    seen = sent.recording.signal.argmax(axis=1)[sent.recording.signal.max(axis=1) > 100]
    assert len(np.unique(seen % 4)) == 4
    assert judged(sent, BOTH['joint'], lone=False).right.shape == (1,)


@pytest.mark.parametrize('member', FAMILY, ids=lambda member: member.name)
def test_blocks_of_a_disturbance_follow_each_other(member: Member) -> None:
    duration_s = 2.5 * BLOCK_FRAMES * SENSOR.period_s
    blocks = list(member.blocks(duration_s, np.random.default_rng(3)))
    sequence = np.concatenate([block.sequence for block in blocks])
    np.testing.assert_array_equal(sequence, np.arange(len(sequence)))
    assert len(sequence) == round(duration_s / SENSOR.period_s)
    for block in blocks:
        none = block.status == Status.NO_TARGET
        assert np.isfinite(block.signal).all()
        assert (np.isnan(block.distance) == none).all()


def test_a_marker_is_identified_no_sooner_than_a_word_after_it_came_into_view() -> None:
    sent = time_to_id.appearing(1.0, np.random.default_rng(3))
    before = sent.recording.stamp_ns < time_to_id.VIEW_S * 1e9
    assert sent.recording.signal[before].max() < WALL_SIGNAL + 15
    times_s, wrong = time_to_id.first_ids(sent, BOTH['joint'])
    assert np.isfinite(times_s).all()
    assert times_s.min() > 19 * BIT_PERIOD_S  # seven bits of the preamble and twelve of the ID
    assert wrong <= 1  # a packet that comes into view half sent may look like another
