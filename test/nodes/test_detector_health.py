# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a detector says of the frames of the last second."""

from dataclasses import replace

import numpy as np
import pytest

from retrolidar_ros.detector import DetectorCounts
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.nodes.detector_health import DetectorHealth
from retrolidar_ros.nodes.diagnostics import ERROR, OK, WARN, Health
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Frame

SETTINGS = defaults()
FRAMES = list(Simulation(load_scene('coffee'), np.random.default_rng(1)).run(3.0))


def judged(frames: list[Frame], counts: DetectorCounts | None = None) -> Health:
    """Return the health after the last of these frames, which come in seconds of 48."""
    health = DetectorHealth(FRAMES[0].grid)
    for number, frame in enumerate(frames):
        if number % 48 == 0:
            health.examine(SETTINGS, {}, DetectorCounts(), [])
        health.monitor.take(frame, 0)
        health.done(frame.stamp_ns, 0.0, 0.0)
    return health.examine(SETTINGS, {}, counts or DetectorCounts(), [])[0]


@pytest.mark.parametrize('stands', [{'stamp_ns'}, {'stamp_ns', 'sensor_time_us'}])
def test_stamps_that_stand_still_are_an_error(stands: set[str]) -> None:
    first = FRAMES[0]
    held = {name: getattr(first, name) for name in stands}
    health = judged([first, *(replace(frame, **held) for frame in FRAMES[1:])])
    assert (health.level, health.summary) == (
        ERROR,
        'the stamps of frames stand still: does /clock?',
    )
    assert judged(FRAMES).level == OK


def test_a_single_overload_is_no_problem_and_many_are() -> None:
    assert judged(FRAMES, DetectorCounts(overloads=1)).level == OK
    health = judged(FRAMES, DetectorCounts(overloads=5))
    assert (health.level, health.values['overloads']) == (WARN, '5')
