# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""After a jump of time a detector is as a new one, number for number."""

from dataclasses import replace

import numpy as np
import pytest

from evaluation.bench.recordings import record
from evaluation.bench.stresses import Stress
from retrolidar_ros.detector import Detection, Detector, create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import Recording

SCENE = Stress('two markers, lost frames, noise', second=0.6, lost=0.1, noise=2.0, sway=0.2)


def scene(seed: int) -> Recording:
    """Return two markers in each zone, of which the clocks are fast."""
    stress = replace(SCENE, clock_error=-0.01 * seed)
    rng = np.random.default_rng(seed)
    recording = record(stress, 150.0, rng, USABLE_IDS, repeated_s=6.0).recording
    recording.ambient[:] = 3.0 * seed
    return recording


def played(detector: Detector, recording: Recording) -> list[tuple[Detection, ...]]:
    """Return what every frame brings."""
    return [tuple(detector.update(frame)) for frame in recording]


@pytest.mark.parametrize('jump_s', [-100.0, 1e4])
def test_a_jump_of_time_leaves_nothing(jump_s: float) -> None:
    before, recording = scene(0), scene(1)
    moved = replace(recording, stamp_ns=recording.stamp_ns + round(jump_s * 1e9))
    fresh = played(create_detector('joint', recording.grid), moved)
    detector = create_detector('joint', recording.grid)
    assert any(played(detector, before))
    again = played(detector, moved)
    assert [len(one) for one in again] == [len(one) for one in fresh]
    assert repr(again) == repr(fresh)
    assert sum(len(one) for one in fresh) > 20
