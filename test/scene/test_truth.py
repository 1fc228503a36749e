# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace

import numpy as np
import pytest

from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.place import Place
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.scene.truth import judge, true_position


def test_truth_is_the_range_at_the_stamp() -> None:
    scene = load_scene('drone')
    (marker,) = scene.markers
    recording = Simulation(scene).run(14.0)
    origin_ns = int(recording.stamp_ns[0])
    end_ns = int(recording.stamp_ns[-10])
    stamp_ns = int(recording.stamp_ns[-40])
    sensor_s = recording.sensor_time_us[-40:-39] * 1e-6
    places = position_at(marker, sensor_s / (1 + scene.sensor.clock_error))
    truth = float(np.linalg.norm(places))
    covariance = np.diag([0.05, 0.05, 0.005, 1, 1, 1]) ** 2
    place = Place(places[0] + (0.06, 0, 0), np.eye(4)[3], covariance, truth + 0.004, 0.005)
    reading = Detection(
        id=marker.id,
        start_ns=end_ns - round(1.302e9),
        stamp_ns=stamp_ns,
        end_ns=end_ns,
        place=place,
        snr_db=20.0,
        evidence=40.0,
        decision_margin=10.0,
        bit_period_s=0.042,
        score=1.0,
        likelihood=1.0,
        corrected_bits=0,
        packets=1,
        zones=(5,),
    )
    ghost = replace(reading, id=7)
    outcome, other = judge(scene, recording, [reading, ghost])
    assert outcome.range_m == pytest.approx(truth, abs=3e-4)
    assert outcome.error_m == pytest.approx(0.004, abs=3e-4)
    assert outcome.place_error_m == pytest.approx(0.06, abs=1e-3)
    assert outcome.place_stddev_m == pytest.approx(0.05)
    assert outcome.good
    sure = replace(reading, place=replace(place, covariance=np.eye(6) * 1e-4))
    (missed, _) = judge(scene, recording, [sure, ghost])
    assert (missed.is_placed, missed.good) == (False, False)
    assert outcome.first_reading_s == pytest.approx((end_ns - origin_ns) * 1e-9)
    assert (other.id, other.name, other.good) == (7, 'ghost', False)
    (unread,) = judge(scene, recording, [])
    assert (unread.readings, unread.good) == (0, False)


def test_a_marker_at_rest_has_one_range_at_all_times() -> None:
    scene = load_scene('drone')
    marker = replace(scene.markers[0], wander=None)
    recording = Simulation(scene).run(1.0)
    places = true_position(scene, marker, recording, np.array([[0.0, 1e8], [2e8, 3e8]]))
    assert places == pytest.approx(np.broadcast_to(marker.position_m, (2, 2, 3)))
