# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a detector counts of its frames, and what it says of zones that blink unread."""

from dataclasses import replace

import numpy as np
import pytest

from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.detector.reception import Reception
from retrolidar_ros.scene import Simulation, parse_scene
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Frame


def frames_of(bit: str = '42 ms', seconds: float = 20.0) -> list[Frame]:
    marker = {'id': 2816, 'position': ['0.1 m', '0.1 m', '1.5 m'], 'bit_period': bit}
    wall = {'distance': '1.6 m', 'signal': '10 kcps/SPAD'}
    return list(Simulation(parse_scene({'markers': [marker], 'surfaces': [wall]})).run(seconds))


def problems(frames: list[Frame], bit_period_s: float, *, all_come: bool = True) -> list[str]:
    """Return what is said once a second, while a detector reads what it can."""
    detector = create_detector('joint', frames[0].grid, bit_period_s=bit_period_s)
    reception = Reception(frames[0].grid)
    found = []
    for number, frame in enumerate(frames):
        if reception.take(frame):
            reception.read(detector.update(frame))
        if number % 48 == 47:
            found.append(reception.unread_problem(NoiseLaw(), bit_period_s, all_come=all_come))
    return found


def test_what_is_read_is_no_problem() -> None:
    assert not any(problems(frames_of(), 0.042))
    assert not any(problems(list(Simulation(load_scene('coffee')).run(20.0)), 0.042))


@pytest.mark.parametrize(('bit', 'milliseconds'), [('46 ms', '46'), ('55 ms', '55')])
@pytest.mark.parametrize('all_come', [True, False])
def test_bits_of_another_length_are_named(bit: str, milliseconds: str, all_come: bool) -> None:
    found = problems(frames_of(bit), 0.042, all_come=all_come)
    assert found[-1].startswith('zone 10 blinks by ')
    assert f'its bits last {milliseconds}.' in found[-1]
    assert 'bit_period is 42.0 ms' in found[-1]


@pytest.mark.parametrize('bit', ['46 ms', '55 ms'])
def test_bits_of_another_length_are_told_within_four_seconds(bit: str) -> None:
    assert any(problems(frames_of(bit, seconds=4.1), 0.042))


def test_noise_blinks_nowhere() -> None:
    rng = np.random.default_rng(1)
    frames = [
        replace(frame, signal=(60 + 4.2 * rng.standard_normal(16)).astype(np.float32))
        for frame in frames_of()
    ]
    assert not any(problems(frames, 0.042))


def test_an_unknown_code_is_missed_only_where_it_may_come() -> None:
    """A regular light that changes at every bit blinks by the right clock, and means nothing."""
    frames = frames_of()
    rng = np.random.default_rng(2)
    bits = rng.integers(0, 2, 2000)
    light = [60 + 40 * bits[int(frame.stamp_ns / 42e6)] for frame in frames]
    strange = [
        replace(frame, signal=np.full(16, level, dtype=np.float32))
        for frame, level in zip(frames, light, strict=True)
    ]
    assert 'of another code' in problems(strange, 0.042)[-1]
    assert not any(problems(strange, 0.042, all_come=False))


def test_gaps_repeats_and_steps_back_are_counted() -> None:
    frames = frames_of(seconds=2.0)
    reception = Reception(frames[0].grid)
    taken = [frames[0], frames[1], frames[1], frames[5], frames[2], frames[3]]
    assert [reception.take(frame) for frame in taken] == [True, True, False, True, True, True]
    assert (reception.frames, reception.lost) == (6, 3)
    assert (reception.repeated, reception.reversed) == (1, 1)


def test_what_was_not_sent_is_not_lost_on_the_way() -> None:
    frames = frames_of(seconds=2.0)
    reception = Reception(frames[0].grid)
    for index, max_lost in ((0, 5), (1, 0), (5, 0), (9, 1), (10, 7)):
        reception.take(frames[index], max_lost)
    assert (reception.lost, reception.unsent) == (1, 5)


def test_the_rate_is_found_from_what_came_however_much_is_lost() -> None:
    frames = frames_of(seconds=8.0)
    kept = np.random.default_rng(3).random(len(frames)) < 0.4
    reception = Reception(frames[0].grid)
    for frame, is_kept in zip(frames, kept, strict=True):
        if is_kept:
            reception.take(frame)
    assert reception.rate_problem(0.042) == ''
    assert 'a frame comes every 2' in reception.rate_problem(0.030)


def test_frames_that_come_late_all_at_once_are_not_too_fast() -> None:
    frames = frames_of(seconds=2.0)
    reception = Reception(frames[0].grid)
    for number, frame in enumerate(frames):
        reception.take(replace(frame, stamp_ns=10**9 + number))
    assert reception.rate_problem(0.042) == ''
