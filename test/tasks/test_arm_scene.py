# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.laboratory import rotation_of
from retrolidar_ros.scene.optics import along
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_parameter_defaults
from retrolidar_ros.tasks.reading import Errors, SensorPose, reading
from retrolidar_ros.tasks.survey import Survey

ARM = load_scene('arm')
COFFEE = load_parameter_defaults(shared_file('config/retrolidar.yaml'), 'coffee')


@pytest.mark.parametrize('seed', [7, 1, 2])
def test_the_emulated_arm_places_all_objects_as_well_as_coffee_wants(seed: int) -> None:
    survey = Survey({}, Errors())
    markers = {one.id: one for one in ARM.markers}
    frames = Simulation(replace(ARM, seed=seed)).run(ARM.duration_s)
    for one in Decoding(defaults()).detect(frames):
        place_m, turned = along(ARM.sensor.path, np.array([one.stamp_ns * 1e-9]))
        found = reading(
            one.id,
            'hand',
            one.stamp_ns * 1e-9,
            one.place.range_m,
            one.place.range_stddev_m,
            one.place.position_m,
            one.place.covariance[:3, :3],
            SensorPose(place_m[0], rotation_of(turned)[0]),
        )
        survey.take(markers[one.id].name, found)
    estimates = {one.name: one for one in survey.estimates()}
    assert set(estimates) == {one.name for one in ARM.markers} == set(COFFEE['objects'])
    for marker in ARM.markers:
        estimate = estimates[marker.name]
        assert estimate.stddev_m <= COFFEE['max_stddev']
        off_m = estimate.position_m - np.array(marker.position_m)
        assert np.linalg.norm(off_m) < 2 * COFFEE['max_stddev']


def test_the_arm_stays_within_the_reach_that_coffee_assumes() -> None:
    places_m = np.array([one.position_m for one in ARM.sensor.path])
    assert np.linalg.norm(places_m - places_m[0], axis=1).max() <= COFFEE['reach']
