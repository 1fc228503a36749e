# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a detector says of the frames of the last second."""

import numpy as np

from retrolidar_ros.detector import DetectorCounts
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.nodes.detector_health import DetectorHealth
from retrolidar_ros.nodes.diagnostics import WARN, Health
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
    return health.examine(SETTINGS, {}, counts or DetectorCounts(), [])


def test_a_single_overload_is_no_problem_and_many_are() -> None:
    assert judged(FRAMES, DetectorCounts(overloads=1)).problems == []
    health = judged(FRAMES, DetectorCounts(overloads=5))
    assert health.values['overloads'] == '5'
    ((level, text),) = health.problems
    assert level == WARN
    assert 'search overloaded in 5 frames' in text
