# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What zones learn of the light of a marker that is followed, when it changes all at once."""

from dataclasses import replace

import numpy as np
import pytest
from harness_core import bind_core
from harness_detector import GRID, ZONE, a_scene, simulate

from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector


def test_a_marker_that_is_three_times_as_bright_at_once_is_followed() -> None:
    """As one that flips towards the sensor: its gains are scaled."""
    recording = simulate(a_scene(start_s=0.0, packets=None), 12.0)
    signal = recording.signal.copy()
    signal[300:, ZONE] = 4.0 + 3.0 * (signal[300:, ZONE] - 4.0)
    detector = create_detector('joint', GRID)
    assert isinstance(detector, LikelihoodDetector)
    for frame in replace(recording, signal=signal):
        detector.update(frame)
        followed = detector.follow(frame)
    assert len(followed) == 1
    assert detector.track_counts.ended == 0


@pytest.mark.parametrize(
    ('zone', 'light', 'crossed', 'learns'),
    [
        (5, 1.0, False, True),  # the strongest
        (5, 0.7, False, False),  # in part of an exposure it may be the clock that is off
        (5, 0.7, True, True),
        (6, 1.0, True, True),  # beside it
        (6, 1.0, False, False),
        (7, 1.0, True, False),  # farther away
    ],
)
def test_a_gain_is_learnt_at_once_where_light_has_moved(
    zone: int, light: float, crossed: bool, learns: bool, tmp_path_factory: pytest.TempPathFactory
) -> None:
    ffi, lib = bind_core(tmp_path_factory, 'zone_light')
    lights, samples = ffi.new('struct rl_zone_light[16]'), ffi.new('struct rl_zone_sample[16]')
    for one in lights:
        one.level, one.level_variance, one.gain_variance, one.excess = 10.0, 0.1, 0.1, 1.0
    lights[5].gain, lights[6].gain, lights[7].gain = 100.0, 40.0, 40.0
    before = lights[zone].gain
    samples[zone] = (True, 10.0 + light * (before + 60.0), 4.0)
    glance = ffi.new('struct rl_glance *', {'step_s': 0.021, 'bit_s': 0.042, 'light': light})
    lib.rl_zone_update(lights, samples, 16, 4, glance, crossed)
    learnt = (lights[zone].gain - before) / 60.0
    assert learnt > 0.9 if learns else learnt < 0.1
    assert np.isfinite(lights[zone].gain_variance)
