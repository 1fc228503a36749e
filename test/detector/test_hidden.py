# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Lone packets beside what goes on, behind glass, and hidden by what passes."""

import numpy as np
import pytest

from evaluation.bench.judging import read_shares
from evaluation.bench.recordings import record
from evaluation.bench.stresses import STRESSES, Stress
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Occlusion, Sensor, Surface

OFTEN = Stress('occluded twice a packet', occlusion=Occlusion(every_s=0.5, lasting_s=0.04))
GLASS = Stress('behind glass', glass=20.0)
STRESS = {stress.name: stress for stress in (*STRESSES, OFTEN, GLASS)}


@pytest.mark.parametrize(
    ('stress', 'signal', 'least'),
    [
        ('occluded as drone', 150.0, 0.95),
        ('occluded twice a packet', 150.0, 0.9),
        ('hand for 250 ms', 150.0, 0.9),
        ('behind glass', 150.0, 0.95),
        ('second marker 25%', 150.0, 0.95),
        ('second marker 50%', 150.0, 0.95),
        ('second marker 70%', 600.0, 0.9),
    ],
)
def test_most_lone_packets_are_read_and_hardly_a_wrong_id(
    stress: str, signal: float, least: float
) -> None:
    found = read_shares(
        lambda rng: record(STRESS[stress], signal, rng, USABLE_IDS),
        3,
        np.random.default_rng(7),
        {'joint': {'method': 'joint'}},
    )['joint']
    assert found['right']['rate'] >= least
    assert found['wrong']['hits'] <= 1


@pytest.mark.parametrize('error', [-0.1, 0.06, 0.1])
def test_a_clock_too_far_off_is_not_read_as_another_id(error: float) -> None:
    found = read_shares(
        lambda rng: record(Stress('clock', clock_error=error), 150.0, rng, USABLE_IDS),
        3,
        np.random.default_rng(155),
        {'joint': {'method': 'joint'}},
    )['joint']
    assert found['wrong']['hits'] <= 1


def test_a_marker_before_a_wall_that_the_sensor_separates_makes_no_other() -> None:
    marker = Marker(id=1447, position_m=(-0.073, -0.379, 1.795), name='own')
    wall = Surface(distance_m=3.07, signal=8.0)
    scene = Scene(seed=0, sensor=Sensor(blur=0.05), markers=(marker,), surfaces=(wall,))
    detector = create_detector('joint', scene.sensor.grid)
    found = [one.id for frame in Simulation(scene).run(20.0) for one in detector.update(frame)]
    assert len(found) >= 14
    assert set(found) == {1447}
