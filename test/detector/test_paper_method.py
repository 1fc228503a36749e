# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the paper's method promises besides, and its stages."""

from dataclasses import replace

import numpy as np
import pytest
from harness_detector import GRID, ID, OTHER_ID, ZONE, a_scene, ids, lone, run, simulate

from retrolidar_ros.detector import create_detector
from retrolidar_ros.detector.paper.stages import fit_preamble, silent_level
from retrolidar_ros.marker.code import packet
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.sensor.model import Status


@pytest.mark.parametrize(('registered', 'read'), [(None, [ID, OTHER_ID]), ([OTHER_ID], [OTHER_ID])])
def test_two_at_once_are_read_or_counted(registered: list[int] | None, read: list[int]) -> None:
    detector = create_detector('paper', GRID, registered_ids=registered)
    scene = a_scene()
    (one,) = scene.markers
    # A little later and in another zone.
    other = replace(one, id=OTHER_ID, position_m=(0.39, -0.39, 1.2), start_s=2.3)
    detections = run(simulate(replace(scene, markers=(one, other))), detector)
    assert ids(detections) == read
    assert {(d.id, d.zones[0]) for d in detections} <= {(ID, ZONE), (OTHER_ID, 3)}
    counts = detector.counts
    if registered:
        assert (counts.accepted, counts.rejected['unregistered']) == (1, 1)
    assert counts.candidates == counts.accepted + sum(counts.rejected.values())


def test_a_slower_bit_is_read_at_a_slower_frame_rate() -> None:
    scene = a_scene(bit_period_s=0.133, start_s=7.0)
    scene = replace(scene, sensor=replace(scene.sensor, period_s=0.0665))
    detector = create_detector('paper', GRID, bit_period_s=0.133)
    assert ids(run(simulate(scene, 14.0), detector)) == [ID]


def test_lost_frames_are_a_gap_and_not_a_shift() -> None:
    recording = list(lone())
    # Second frame of a bit in the preamble and in the word, and a whole bit.
    begin = next(i for i, frame in enumerate(recording) if frame.stamp_ns >= 2_000_000_000)
    lost = {begin + 5, begin + 31, begin + 40, begin + 41}
    (detection,) = run(frame for index, frame in enumerate(recording) if index not in lost)
    assert detection.id == ID
    assert detection.start_ns == pytest.approx(2.0e9, abs=25e6)


def test_abnormal_samples_are_not_believed() -> None:
    signal, distance, status = lone().signal.copy(), lone().distance.copy(), lone().status.copy()
    hit = np.random.default_rng(5).random(signal.shape) < 0.05
    signal[hit], distance[hit], status[hit] = 1000.0, 3.9, Status.SIGMA_TOO_HIGH
    garbage = replace(lone(), signal=signal, distance=distance, status=status)
    (detection,) = (detection for detection in run(garbage) if detection.id == ID)
    assert detection.place.range_m == pytest.approx(1.2, abs=2e-3)


def test_range_is_the_mean_of_all_distances_of_the_packet() -> None:
    distance = np.random.default_rng(6).uniform(1, 2, lone().distance.shape).astype(np.float32)
    distance[::7] = np.nan
    (detection,) = run(replace(lone(), distance=distance))
    used = (lone().stamp_ns >= detection.start_ns) & (lone().stamp_ns <= detection.end_ns)
    assert used.sum() == 62
    expected = np.nanmean(distance[used, ZONE]) / GRID.z_per_range[ZONE]
    assert detection.place.range_m == pytest.approx(expected, rel=1e-6)


def test_a_marker_between_zones_is_one_detection_with_the_stronger_zone_first() -> None:
    scene = a_scene(position_m=(0.004, 0.13, 1.2))  # most of it right of the middle
    (detection,) = run(simulate(scene))
    assert detection.zones == (10, 9)


def test_nothing_is_seen_where_nothing_blinks() -> None:
    steady = simulate(replace(a_scene(), sensor=Sensor(), markers=()), 20.0)
    wall = simulate(replace(a_scene(), markers=()), 6.0)
    status = wall.status.copy()
    status[:40] = Status.NO_TARGET  # it begins with the first normal sample
    late = replace(wall, status=status, signal=wall.signal + np.float32(40))
    for recording in (steady, simulate(Scene(), 5.0), late):
        detector = create_detector('paper', GRID)
        assert run(recording, detector) == []
        assert detector.counts.candidates == 0


def test_preamble_fit_is_the_papers_equations() -> None:
    rng = np.random.default_rng(11)
    signal = rng.uniform(0, 50, (14, 5))
    d = rng.uniform(1, 50, 5)
    fit = fit_preamble(signal, d)
    p = [bit for bit in (1, 0, 1, 0, 1, 0, 1) for _ in range(2)]
    for zone in range(5):
        s = [float(value) - float(d[zone]) for value in signal[:, zone]]
        c = sum(a * b for a, b in zip(p, s, strict=True)) / sum(a * a for a in p)
        e = sum((b - c * a) ** 2 for a, b in zip(p, s, strict=True)) ** 0.5
        assert fit.c[zone] == pytest.approx(c)
        assert fit.e[zone] == pytest.approx(e)
        assert fit.likelihood[zone] == pytest.approx(c * c / ((e + 1) * d[zone]))
    assert fit_preamble(np.zeros((14, 1)), np.zeros(1)).likelihood.tolist() == [0.0]


def test_silent_level_is_the_mean_before_a_marker_wakes() -> None:
    rng = np.random.default_rng(11)
    silent = 30.0 + 2.0 * rng.standard_normal((62, 4000))
    level = silent_level(silent)
    exact = np.isclose(level, silent.mean(axis=0))
    assert exact.mean() > 0.8
    # Where noise looks like bits the bright half of it is taken, 0.8 deviations too high.
    assert level[~exact].mean() - 30.0 == pytest.approx(0.8 * 2.0, abs=0.3)
    # While a marker transmits it is the bright one.
    shining = np.repeat(np.where(packet(np.arange(1, 4095)), 10.0, 30.0), 2, axis=-1).T
    assert silent_level(shining) == pytest.approx([30.0] * 4094)
    noisy = shining + 2.0 * rng.standard_normal(shining.shape)
    assert silent_level(noisy).mean() == pytest.approx(30.0, abs=0.1)
