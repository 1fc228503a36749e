# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import inspect
from dataclasses import replace
from typing import cast

import numpy as np
import pytest

from evaluation.bench.detectors import knob, new_detector
from evaluation.bench.link import (
    SILENCE_BITS,
    link_scene,
    lone_duration_s,
    lone_trial,
    outcome,
    read,
)
from evaluation.report.panels import SLOW_BIT_PERIOD_S, SLOW_SENSOR
from retrolidar_ros.detector import METHODS, Detection, Detector, create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import Surface
from retrolidar_ros.scene.marker_budget import needed_swing
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Recording


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.mark.parametrize('snr_db', [-2.0, 6.0, 14.0, 20.0])
def test_a_link_is_as_strong_as_wanted(snr_db: float, rng: np.random.Generator) -> None:
    scene = link_scene(snr_db, rng, packets=None)
    silent = replace(scene.sensor, noise=None, ranging=None)
    light = Simulation(replace(scene, sensor=silent), rng).run(30)
    bright, dark = light.signal.max(axis=0), light.signal.min(axis=0)
    # The noise at the mean level, measured on a wall that is as bright.
    wall = Surface(1.0, float((bright + dark).mean() / 2))
    steady = Simulation(replace(scene, markers=(), surfaces=(wall,)), rng).run(60)
    measured_db = 20 * np.log10((bright - dark) / steady.signal.std())
    # A reported signal is never negative, which takes a little off the noise of the weakest.
    assert measured_db == pytest.approx(np.full(16, snr_db), abs=0.5 if snr_db < 0 else 0.2)


def test_amplitude_grows_with_the_link() -> None:
    snrs_db = np.arange(-10, 30)
    assert (np.diff([needed_swing(float(snr_db)) for snr_db in snrs_db]) > 0).all()


def test_lone_packets_come_after_silence_and_end_before_the_recording(
    rng: np.random.Generator,
) -> None:
    scene = link_scene(30, rng)
    starts_s = np.array([marker.start_s for marker in scene.markers])
    assert starts_s.min() >= SILENCE_BITS * BIT_PERIOD_S
    assert lone_duration_s(scene) >= starts_s.max() + PACKET_BITS * BIT_PERIOD_S
    assert len({marker.id for marker in scene.markers}) == 16
    trial = lone_trial(scene, rng)
    time_s = trial.recording.stamp_ns * 1e-9
    dark = trial.recording.signal < WALL_SIGNAL + needed_swing(30) / 2
    for zone, start_s in enumerate(starts_s):
        first_s, last_s = time_s[dark[:, zone]][[0, -1]]
        assert first_s == pytest.approx(start_s, abs=0.022)
        assert last_s <= start_s + PACKET_BITS * BIT_PERIOD_S + 0.011


def test_endless_markers_send_from_the_beginning_at_random_phases(
    rng: np.random.Generator,
) -> None:
    starts_s = [marker.start_s for marker in link_scene(10, rng, packets=None).markers]
    assert min(starts_s) >= -PACKET_BITS * BIT_PERIOD_S
    assert max(starts_s) <= 0
    assert np.std(starts_s) > 0.2


def test_a_slow_sensor_gets_slow_packets(rng: np.random.Generator) -> None:
    scene = link_scene(10, rng, sensor=SLOW_SENSOR, bit_period_s=SLOW_BIT_PERIOD_S)
    trial = lone_trial(scene, rng)
    assert trial.recording.signal.shape[1] == 64
    assert len(trial.recording) == pytest.approx(2 * (60 + 12 + 31 + 12), abs=6)


class Oracle:
    """Reads at one frame what it is told to."""

    def __init__(self, frame: int, readings: list[tuple[int, int]]) -> None:
        self._frame = frame
        self._readings = readings

    def update_all(self, recording: Recording) -> list[Detection]:
        end_ns = int(recording.stamp_ns[self._frame])
        return [
            cast(Detection, Reading(identity, zone, end_ns)) for identity, zone in self._readings
        ]


class Reading:
    def __init__(self, identity: int, zone: int, end_ns: int) -> None:
        self.id = identity
        self.end_ns = end_ns
        self.zones = (zone, (zone + 1) % 16)


def test_a_reading_is_judged_by_the_markers_of_its_first_zone(rng: np.random.Generator) -> None:
    trial = lone_trial(link_scene(10, rng), rng)
    ids = [marker.id for marker in trial.scene.markers]
    oracle = cast(Detector, Oracle(7, [(ids[3], 3), (ids[3], 4), (ids[5], 5), (ids[4], 5)]))
    readings = read(trial, oracle)
    assert [(reading.zone, reading.right) for reading in readings] == [
        (3, True),
        (4, False),
        (5, True),
        (5, False),
    ]
    assert {reading.end_ns for reading in readings} == {trial.recording.stamp_ns[7]}
    result = outcome(trial, oracle)
    assert np.flatnonzero(result.right).tolist() == [3, 5]
    assert np.flatnonzero(result.wrong).tolist() == [4, 5]


def test_a_second_marker_in_a_zone_is_right_too(rng: np.random.Generator) -> None:
    trial = lone_trial(link_scene(10, rng), rng)
    second = tuple(replace(marker, id=marker.id ^ 1) for marker in trial.scene.markers)
    both = trial._replace(scene=replace(trial.scene, markers=trial.scene.markers + second))
    oracle = Oracle(0, [(second[2].id, 2), (trial.scene.markers[2].id, 2), (second[2].id, 3)])
    result = outcome(both, cast(Detector, oracle))
    assert np.flatnonzero(result.right).tolist() == [2]
    assert np.flatnonzero(result.wrong).tolist() == [3]


@pytest.mark.parametrize('method', METHODS)
def test_every_method_reads_a_strong_link_and_nothing_of_none(
    method: str, rng: np.random.Generator
) -> None:
    strong = lone_trial(link_scene(30, rng), rng)
    assert np.count_nonzero(outcome(strong, new_detector(method, SENSOR.grid)).right) >= 9
    none = lone_trial(link_scene(-30, rng), rng)
    assert not outcome(none, new_detector(method, SENSOR.grid)).right.any()


@pytest.mark.parametrize('method', METHODS)
def test_the_knob_is_one_of_the_detector(method: str) -> None:
    name, values = knob(method)
    assert name in inspect.signature(create_detector).parameters
    assert len(values) == 5
    for strictness in values:
        new_detector(method, SENSOR.grid, strictness=strictness)


def test_a_stricter_knob_reads_less_of_weak_links(rng: np.random.Generator) -> None:
    trials = [lone_trial(link_scene(8, rng), rng) for _ in range(3)]
    lax, strict = (
        sum(
            np.count_nonzero(
                outcome(trial, new_detector('paper', SENSOR.grid, strictness=strictness)).right
            )
            for trial in trials
        )
        for strictness in (0.2, 0.5)
    )
    assert lax > strict
