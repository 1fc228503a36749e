# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings whose truth is known, and what is found of it."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from retrolidar_ros.cli.calibrate import missing, parameters, sentences
from retrolidar_ros.scene import Simulation, parse_scene
from retrolidar_ros.scene.description import Noise, Occlusion, Waypoint
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.tasks.calibration import calibrate
from retrolidar_ros.tasks.noise import Estimate

WALL = [0, 1, 2, 3, 5, 6, 7, 9, 10, 11, 13, 14, 15]
FOREIGN: dict[str, Any] = {
    'seed': 3,
    'ambient': '4 kcps/SPAD',
    'sensor': {
        'period': '33.3 ms',
        'period_error': '0.3 %',
        'jitter': '1 ms',
        'lost': '2 %',
        'noise': {'floor': '18 (kcps/SPAD)^2', 'slope': '0.9 kcps/SPAD'},
        'ranging': {'shot': '490 mm', 'floor': '1.6 mm', 'offset': '14 mm'},
    },
    'markers': [
        {
            'id': 2816,
            'position': ['0.075 m', '0.075 m', '0.7 m'],
            'bit_period': '80 ms',
            'clock_error': '0.6 %',
            'contrast': '92 %',
            'signal_at_1_m': '240 kcps/SPAD',
            'response': {'dark': '0.6 ms', 'bright': '9 ms'},
        }
    ],
    'surfaces': [
        {'distance': '0.72 m', 'signal': '20 kcps/SPAD', 'zones': WALL},
        {'distance': '1.2 m', 'signal': '60 kcps/SPAD', 'zones': [4]},
        {'distance': '1.2 m', 'signal': '120 kcps/SPAD', 'zones': [8]},
        {'distance': '1.2 m', 'signal': '200 kcps/SPAD', 'zones': [12]},
    ],
}
DISTANCE_M = math.hypot(0.075, 0.075, 0.7)
SCENE = parse_scene(FOREIGN)


def recorded(seconds: float = 30.0, sensor: Any = None, **changes: Any) -> Recording:
    """Record the scene, some of it and of its sensor changed."""
    changed = replace(SCENE.sensor, **(sensor or {}))
    return Simulation(replace(SCENE, sensor=changed, **changes)).run(seconds)


def holds(estimate: Estimate | None, truth: float) -> bool:
    """Tell whether an estimate is as near to the truth as it says, but for one case in 300."""
    assert estimate is not None
    return abs(estimate.value - truth) < 3 * estimate.stddev


def test_all_is_found_in_a_recording_of_a_foreign_sensor() -> None:
    recording = recorded()
    found = calibrate(recording, distance_m=DISTANCE_M)
    noise = found.noise
    assert noise is not None
    assert 10 not in noise.zones
    assert holds(noise.floor, 18.0)
    assert holds(noise.slope, 0.9)
    assert noise.floor.stddev < 2
    assert noise.ambient is None
    (marker,) = found.markers
    assert (marker.id, marker.zone) == (2816, 10)
    assert holds(marker.bit_period_s, 0.08 * 1.006)
    assert marker.bit_period_s.stddev < 1e-4
    assert found.offset_m is not None
    assert abs(found.offset_m.value - 0.014) < 2e-3
    law = ['noise_floor', 'noise_slope', 'noise_ambient']
    assert list(parameters(found)) == ['bit_period', *law, 'range_offset']
    with pytest.raises(ValueError, match=r'5 m is not the distance .* ID 2816 is at 0\.72 m'):
        calibrate(recording, distance_m=5.0)
    with pytest.raises(ValueError, match='60 frames are too few to calibrate from'):
        calibrate(Recording.of(list(recording)[:60]))


@pytest.mark.parametrize('scale', [0.125, 1.0, 8.0])
def test_noise_of_any_size(scale: float) -> None:
    noise = Noise(4.6 * scale, 0.22 * scale)
    found = calibrate(recorded(sensor={'noise': noise})).noise
    assert found is not None
    signal = np.array([5.0, 30.0, 200.0])
    truth = noise.floor + noise.slope * signal
    np.testing.assert_allclose(found.law.variance(signal), truth, rtol=0.15)


def test_ambient_light_that_varies_gives_its_noise() -> None:
    sensor = {'noise': Noise(4.6, 0.22, 0.5)}
    dim, lit = recorded(15, sensor, ambient=2.0), recorded(15, sensor, ambient=60.0, seed=9)
    later = int(dim.stamp_ns[-1]) + 33_000_000
    both = Recording.of([*dim, *(replace(frame, stamp_ns=frame.stamp_ns + later) for frame in lit)])
    found = calibrate(both).noise
    assert found is not None
    assert holds(found.ambient, 0.5)


def test_a_marker_that_moves_has_a_clock_and_no_range() -> None:
    ends = Waypoint(0, (-0.25, 0, 0)), Waypoint(20, (0.25, 0, 0)), Waypoint(40, (-0.25, 0, 0))
    marker = replace(SCENE.markers[0], position_m=(0.0, 0.03, 0.6), bit_period_s=0.0667)
    recording = recorded(sensor={'path': ends}, markers=(marker,))
    found = calibrate(recording, distance_m=DISTANCE_M)
    assert found.markers[0].moves
    assert set(parameters(found)) >= {'bit_period'}
    assert found.offset_m is None
    assert any('moves, so its range' in line for line in sentences(found))


# What is not there is not reported.


def test_without_a_marker_there_is_noise_and_advice() -> None:
    found = calibrate(recorded(markers=()))
    assert (found.markers, found.offset_m) == ([], None)
    assert set(parameters(found)) == {'noise_floor', 'noise_slope', 'noise_ambient'}
    assert any(line.startswith('No zone blinks') for line in missing(found))


def test_noise_of_ambient_light_does_not_blink_where_no_zone_is_measured() -> None:
    sensor = {'noise': Noise(4.6, 0.22, 0.22), 'abnormal': 0.5}
    found = calibrate(recorded(sensor=sensor, ambient=200.0, markers=()))
    assert found.noise is None
    assert found.zones == []


def test_a_scene_without_noise_is_said_to_have_none() -> None:
    advice = missing(calibrate(recorded(sensor={'noise': None}), distance_m=DISTANCE_M))
    (line,) = [line for line in advice if 'noise' in line]
    assert line.startswith('The recording has no noise, so nothing can be told of it: give the')


def test_zones_that_are_alike_give_no_slope() -> None:
    wall = replace(SCENE.surfaces[0], zones=None)
    found = calibrate(recorded(surfaces=(wall,), markers=()))
    assert found.noise is not None
    assert found.noise.slope is None
    assert float(found.noise.law.variance(np.array(20.0))) == pytest.approx(36, rel=0.1)
    assert any('white paper' in line for line in missing(found))
    assert any('is taken to be as usual' in line for line in sentences(found))


def test_a_blinking_light_that_is_no_marker_has_a_period_and_no_id() -> None:
    hidden = Occlusion(every_s=0.2, lasting_s=0.1)
    lamp = replace(SCENE.markers[0], packets=1, start_s=1000.0, occlusion=hidden)
    found = calibrate(recorded(8, markers=(lamp,)))
    assert found.markers == []
    assert 'bit_period' not in parameters(found)
    assert any('no ID fits' in line for line in sentences(found))


def test_two_markers_are_measured_apart() -> None:
    other = replace(SCENE.markers[0], id=204, position_m=(-0.2, -0.2, 0.9), contrast=0.8)
    found = calibrate(recorded(markers=(*SCENE.markers, other)))
    near, far = found.markers
    assert (near.id, far.id) == (2816, 204)
    assert near.zone != far.zone
    for marker in (near, far):
        assert holds(marker.bit_period_s, 0.08 * 1.006)


def test_a_marker_whose_dark_bits_are_no_target_is_no_zone_at_rest() -> None:
    wall, *paper = SCENE.surfaces
    sensor = {'target_threshold': 15.0, 'noise': Noise(4.6, 0.22)}
    marker = replace(SCENE.markers[0], contrast=1.0, bit_period_s=0.18)
    surfaces = (replace(wall, signal=3.0), *paper)
    found = calibrate(recorded(sensor=sensor, markers=(marker,), surfaces=surfaces))
    assert found.noise is not None
    assert found.noise.zones == [4, 8, 12]
    assert [one.id for one in found.markers] == [2816]
