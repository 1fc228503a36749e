# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
from collections.abc import Callable

import numpy as np
import pytest

from evaluation.bench.link import link_scene
from evaluation.bench.rates import Rate, rate
from evaluation.bench.stress import (
    HAND_DISTANCE_M,
    HAND_SIGNAL,
    appear,
    drift,
    hide,
    light_of,
    lose_dark,
    sensed,
)
from evaluation.experiments.stability import breaking_points
from evaluation.report.panels import PANELS, SNR_DB, Panel
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.marker_budget import needed_swing
from retrolidar_ros.scene.reference import NOISE, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats, Recording, Status

PACKET_S = PACKET_BITS * BIT_PERIOD_S
PANEL = {panel.name: panel for panel in PANELS}


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture
def scene(rng: np.random.Generator) -> Scene:
    return link_scene(SNR_DB, rng)


@pytest.fixture
def light(scene: Scene, rng: np.random.Generator) -> Recording:
    return light_of(scene, rng)


def since_start_s(light: Recording, scene: Scene) -> Floats:
    starts_s = np.array([marker.start_s for marker in scene.markers])
    since: Floats = light.stamp_ns[:, None] * 1e-9 - starts_s
    return since


def test_light_has_no_noise(light: Recording) -> None:
    assert light.signal[:20] == pytest.approx(WALL_SIGNAL + needed_swing(SNR_DB), rel=1e-5)
    assert light.signal.min() == pytest.approx(WALL_SIGNAL, rel=1e-5)
    assert (light.distance == light.distance[0]).all()


def test_the_sensors_noise_belongs_to_the_light(
    light: Recording, scene: Scene, rng: np.random.Generator
) -> None:
    recordings = [sensed(light, scene.sensor, rng) for _ in range(40)]
    deviation = np.stack([recording.signal for recording in recordings]) - light.signal
    for level in (WALL_SIGNAL, WALL_SIGNAL + needed_swing(SNR_DB)):
        at_level = deviation[:, np.abs(light.signal - level) < 0.01]
        # Nothing is reported as negative, which takes a little off the noise of a dark wall.
        assert at_level.var() == pytest.approx(NOISE.floor + NOISE.slope * level, rel=0.15)
    assert recordings[0].distance.std(axis=0).min() > 0.01


@pytest.mark.parametrize('gain', [-1.0, -0.4, 0.0, 0.6, 1.0])
def test_drift_changes_the_markers_light_only(gain: float, light: Recording, scene: Scene) -> None:
    drifted = drift(light, scene, gain)
    since_s = since_start_s(light, scene)
    before = drifted.signal[since_s < -0.05] - WALL_SIGNAL
    after = drifted.signal[since_s > PACKET_S + 0.05] - WALL_SIGNAL
    assert before == pytest.approx(needed_swing(SNR_DB) * (1 - gain / 2), rel=1e-4)
    assert after == pytest.approx(needed_swing(SNR_DB) * (1 + gain / 2), rel=1e-4)
    middle = np.abs(since_s - PACKET_S / 2) < 0.011
    assert drifted.signal[middle] == pytest.approx(light.signal[middle], rel=0.02)
    dark = light.signal < WALL_SIGNAL + 1e-3
    assert drifted.signal[dark] == pytest.approx(WALL_SIGNAL, abs=2e-3)


@pytest.mark.parametrize('lasting_s', [0.0, 0.01, 0.3])
def test_a_hand_hides_the_middle_of_every_packet(
    lasting_s: float, light: Recording, scene: Scene
) -> None:
    hidden = hide(light, scene, lasting_s)
    from_middle_s = np.abs(since_start_s(light, scene) - PACKET_S / 2)
    beyond = from_middle_s > lasting_s / 2 + 0.011
    assert (hidden.signal[beyond] == light.signal[beyond]).all()
    assert (hidden.distance[beyond] == light.distance[beyond]).all()
    within = from_middle_s < lasting_s / 2 - 0.011
    assert hidden.signal[within] == pytest.approx(HAND_SIGNAL)
    assert hidden.distance[within] == pytest.approx(HAND_DISTANCE_M)
    # Of frames that begin or end it, their share: the sum is the whole time.
    shares = (hidden.signal - light.signal) / (HAND_SIGNAL - light.signal)
    assert shares.sum(axis=0) * 0.021 == pytest.approx(lasting_s, abs=1e-4)


def test_before_it_appears_a_marker_is_a_wall(light: Recording) -> None:
    seen = appear(light, 2.0)
    before = light.stamp_ns < 2e9
    assert before.any()
    assert (seen.signal[before] == np.float32(WALL_SIGNAL)).all()
    assert (seen.signal[~before] == light.signal[~before]).all()


@pytest.mark.parametrize('share', [0.0, 0.3, 1.0])
def test_dark_samples_are_lost_and_no_bright_ones(
    share: float, light: Recording, scene: Scene, rng: np.random.Generator
) -> None:
    recording = sensed(light, scene.sensor, rng)
    lossy = lose_dark(recording, light, share, rng)
    lost = lossy.status == Status.NO_TARGET
    dark = light.signal < WALL_SIGNAL + needed_swing(SNR_DB) / 2
    assert not lost[~dark].any()
    assert lost[dark].mean() == pytest.approx(share, abs=0.07)
    assert (lossy.signal[lost] == 0).all()
    assert np.isnan(lossy.distance[lost]).all()
    assert (lossy.signal[~lost] == recording.signal[~lost]).all()


@pytest.mark.parametrize('panel', PANELS, ids=lambda panel: panel.name)
def test_every_panel_makes_trials_over_its_whole_sweep(
    panel: Panel, rng: np.random.Generator
) -> None:
    assert panel.harmless in panel.values
    assert {panel.values[0], panel.values[-1]} == {min(panel.values), max(panel.values)}
    for value in (panel.values[0], panel.harmless, panel.values[-1]):
        trial = panel.trial(value, rng)
        assert trial.recording.grid == panel.grid
        assert len(trial.scene.markers) % panel.grid.zones == 0
        assert np.isfinite(trial.recording.signal).all()


def lost_share(recording: Recording) -> float:
    return 1 - len(recording) / float(recording.sequence[-1] + 1)


def period_deviation_ms(recording: Recording) -> float:
    deviations = recording.stamp_ns * 1e-6 - (recording.sequence + 0.5) * 21.0
    return float(deviations.std())


def abnormal_percent(recording: Recording) -> float:
    return 100 * float(np.isin(recording.status, (0, 1, 3, 4, 7, 8, 11)).mean())


@pytest.mark.parametrize(
    ('name', 'value', 'measure', 'expected'),
    [
        ('lost_frames', 40, lost_share, pytest.approx(0.4, abs=0.1)),
        ('jitter', 3, period_deviation_ms, pytest.approx(2.85, abs=0.5)),
        ('abnormal', 30, abnormal_percent, pytest.approx(30, abs=3)),
    ],
)
def test_the_sensor_is_stressed(
    name: str,
    value: float,
    measure: Callable[[Recording], float],
    expected: object,
    rng: np.random.Generator,
) -> None:
    assert measure(PANEL[name].trial(value, rng).recording) == expected


@pytest.mark.parametrize(
    ('name', 'value', 'bit_s'), [('clock_skew', 2, 0.04284), ('bit_period', 39, 0.039)]
)
def test_the_marker_is_too_slow_or_too_fast(
    name: str, value: float, bit_s: float, rng: np.random.Generator
) -> None:
    for marker in PANEL[name].trial(value, rng).scene.markers:
        assert marker.bit_period_s * (1 + marker.clock_error) == pytest.approx(bit_s)


def test_a_far_wall_takes_over_distance_and_signal_of_dark_bits(rng: np.random.Generator) -> None:
    recording = PANEL['far_wall'].trial(0.8, rng).recording
    far = recording.distance > 1.5
    assert 0.05 < far.mean() < 0.3
    wall = 0.8 * (WALL_SIGNAL + needed_swing(SNR_DB))
    assert recording.signal[far].mean() == pytest.approx(wall, rel=0.05)


def test_two_markers_of_a_zone_differ_and_overlap(rng: np.random.Generator) -> None:
    markers = PANEL['two_markers'].trial(40, rng).scene.markers
    assert len(markers) == 32
    for first, second in zip(markers[:16], markers[16:], strict=True):
        assert first.id != second.id
        assert 0 < second.id < 4095
        assert abs(first.start_s - second.start_s) < PACKET_S
        assert second.size_m**2 / first.size_m**2 == pytest.approx(0.4)


def shares(*percents: int) -> list[Rate]:
    return [rate(percent, 100) for percent in percents]


def test_breaking_points_on_both_sides_of_the_harmless_value() -> None:
    breaks = breaking_points(PANEL['clock_skew'], [-2, -1, 0, 1, 2], shares(0, 90, 95, 70, 0))
    assert breaks['holds'] is True
    assert breaks['below'] == pytest.approx(-1 - 1 / 9)
    assert breaks['above'] == pytest.approx(0.6)


def test_breaking_points_of_what_holds_and_of_what_never_does() -> None:
    panel = PANEL['lost_frames']
    assert breaking_points(panel, [0, 10], shares(95, 85)) == {
        'holds': True,
        'below': None,
        'above': None,
    }
    assert breaking_points(panel, [0, 10], shares(75, 85)) == {
        'holds': False,
        'below': None,
        'above': None,
    }


def test_a_sweep_of_links_breaks_downward() -> None:
    breaks = breaking_points(PANEL['snr'], [20, 10, 0], shares(100, 90, 0))
    assert breaks['below'] == pytest.approx(10 - 10 / 9)
    assert breaks['above'] is None


def signal_in_packets(name: str, value: float, begin: float, end: float) -> Floats:
    """Return the signals of a panel's trial within parts of every packet, by their start."""
    trial = PANEL[name].trial(value, np.random.default_rng(0))
    since_s = since_start_s(trial.recording, trial.scene)
    within = (since_s > begin * PACKET_S) & (since_s < end * PACKET_S)
    signal: Floats = trial.recording.signal[within]
    return signal


def test_percents_and_milliseconds_of_the_panels_are_what_they_say() -> None:
    bright = WALL_SIGNAL + needed_swing(SNR_DB)
    before = signal_in_packets('drift', 50, -0.5, -0.02)
    assert before.mean() == pytest.approx(WALL_SIGNAL + 0.75 * needed_swing(SNR_DB), rel=0.05)
    hidden = signal_in_packets('hand', 300, 0, 1) > HAND_SIGNAL / 2
    assert hidden.mean() == pytest.approx(0.3 / PACKET_S, rel=0.1)
    # Of the preamble's seven bits four are dark.
    vanished = signal_in_packets('no_target', 50, 0, 7 / PACKET_BITS) == 0
    assert vanished.mean() == pytest.approx(4 / 7 / 2, abs=0.1)
    strong = signal_in_packets('snr', 20, -0.5, -0.02)
    assert strong.mean() == pytest.approx(WALL_SIGNAL + needed_swing(20), rel=0.05)
    usual = signal_in_packets('two_markers', 0, -0.5, -0.02)
    assert usual.mean() == pytest.approx(bright, rel=0.05)
