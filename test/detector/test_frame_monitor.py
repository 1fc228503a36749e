# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a detector counts of its frames, and what it says of zones that blink unread."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from retrolidar_ros.detector.frame_monitor import FrameMonitor
from retrolidar_ros.detector.parameters import DetectorSettings, defaults
from retrolidar_ros.scene import Simulation, parse_scene
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Frame


def frames_of(bit: str = '42 ms', seconds: float = 20.0) -> list[Frame]:
    marker = {'id': 2816, 'position': ['0.1 m', '0.1 m', '1.5 m'], 'bit_period': bit}
    wall = {'distance': '1.6 m', 'signal': '10 kcps/SPAD'}
    return list(Simulation(parse_scene({'markers': [marker], 'surfaces': [wall]})).run(seconds))


def findings(frames: list[Frame], **changes: Any) -> list[str]:
    """Return what is said once a second, while a detector reads what it can."""
    settings = DetectorSettings({**defaults(), **changes})
    detector = settings.detector(frames[0].grid)
    monitor = FrameMonitor(frames[0].grid)
    found = []
    for number, frame in enumerate(frames):
        if monitor.take(frame):
            monitor.read(detector.update(frame))
        if number % 48 == 47:
            found.append(str(monitor.unread(settings) or ''))
    return found


def test_what_is_read_is_no_problem() -> None:
    assert not any(findings(frames_of()))
    assert not any(findings(list(Simulation(load_scene('coffee')).run(20.0))))


@pytest.mark.parametrize(('bit', 'set_s'), [('46 ms', 0.042), ('40 ms', 0.042), ('42 ms', 0.063)])
def test_one_bit_period_is_advised_and_it_reads(bit: str, set_s: float) -> None:
    """Bits of 42 ms and more have a clock; of 40 ms, alias 44.2, two bit periods are tried."""
    said = [one for one in findings(frames_of(bit), bit_period=set_s) if one]
    assert len(said) > 5
    assert len(set(said)) == 1
    advised_s = float(said[0].split()[-1])
    assert advised_s == pytest.approx(float(bit.split()[0]) * 1e-3, rel=0.006)
    assert 'ID 2816 is read with' in said[0]


def test_a_pause_of_frames_is_no_bit_period() -> None:
    """As when a sensor was stopped, or its cable was out."""
    frames = frames_of()
    for number in range(200, 800, 60):
        later = [replace(frame, stamp_ns=frame.stamp_ns + 4 * 10**9) for frame in frames[number:]]
        assert not any(findings([*frames[:number], *later]))


def test_a_marker_that_may_not_come_is_not_missed() -> None:
    assert not any(findings(frames_of('46 ms'), registered_ids=[7]))


@pytest.mark.parametrize('bit', ['46 ms', '55 ms'])
def test_bits_of_another_length_are_told_within_four_seconds(bit: str) -> None:
    assert any(findings(frames_of(bit, seconds=4.1)))


def test_noise_blinks_nowhere() -> None:
    rng = np.random.default_rng(1)
    frames = [
        replace(frame, signal=(60 + 4.2 * rng.standard_normal(16)).astype(np.float32))
        for frame in frames_of()
    ]
    assert not any(findings(frames))


def test_an_unknown_code_is_missed_only_where_it_may_come() -> None:
    """A regular light that changes at every bit blinks by the right clock, and means nothing."""
    frames = frames_of()
    rng = np.random.default_rng(2)
    bits = rng.integers(0, 2, 2000)
    light = [60 + 40 * bits[int(frame.stamp_ns / 42e6)] for frame in frames]
    strange = [
        replace(frame, signal=np.where(np.arange(16) < 8, level, frame.signal).astype(np.float32))
        for frame, level in zip(frames, light, strict=True)
    ]
    assert 'no ID fits (tried bits of 42.0' in findings(strange)[-1]
    assert not any(findings(strange, registered_ids=[7]))


def test_gaps_repeats_and_steps_back_are_counted() -> None:
    frames = frames_of(seconds=2.0)
    monitor = FrameMonitor(frames[0].grid)
    taken = [frames[0], frames[1], frames[1], frames[5], frames[2], frames[3]]
    assert [monitor.take(frame) for frame in taken] == [True, True, False, True, True, True]
    assert (monitor.frames, monitor.lost) == (6, 3)
    assert (monitor.repeated, monitor.reversed) == (1, 1)


def test_what_was_not_sent_is_not_lost_on_the_way() -> None:
    frames = frames_of(seconds=2.0)
    monitor = FrameMonitor(frames[0].grid)
    for index, max_lost in ((0, 5), (1, 0), (5, 0), (9, 1), (10, 7)):
        monitor.take(frames[index], max_lost)
    assert (monitor.lost, monitor.unsent) == (1, 5)


def test_the_rate_is_found_from_what_came_however_much_is_lost() -> None:
    frames = frames_of(seconds=8.0)
    kept = np.random.default_rng(3).random(len(frames)) < 0.4
    monitor = FrameMonitor(frames[0].grid)
    for frame, is_kept in zip(frames, kept, strict=True):
        if is_kept:
            monitor.take(frame)
    assert monitor.rate(0.042) is None
    assert monitor.rate(0.021) is None
    assert 'a frame comes every 2' in str(monitor.rate(0.015))
    assert '14.3 frames, and not one to eight' in str(monitor.rate(0.3))


def test_frames_that_come_late_all_at_once_are_not_too_fast() -> None:
    frames = frames_of(seconds=2.0)
    monitor = FrameMonitor(frames[0].grid)
    for number, frame in enumerate(frames):
        monitor.take(replace(frame, stamp_ns=10**9 + number))
    assert monitor.rate(0.042) is None
