# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from evaluation.bench.detectors import new_detector
from evaluation.bench.hand import (
    Pose,
    markers_at,
    random_pose,
    rotation,
    sees_all,
    view_from,
    yaw_of,
)
from evaluation.bench.live import PlaceError, held, place_error, read_live
from evaluation.experiments import coffee, drone
from evaluation.experiments.registry import EXPERIMENTS, run_experiments
from retrolidar_ros.detector.place import place, zone_bearing
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.truth import true_range
from retrolidar_ros.sensor.frame import Floats, ZoneGrid

WORLD = load_scene('coffee')
NO_TURN = rotation(0, 0, 0)
ANGLES = st.floats(-math.pi, math.pi)


def at(*position_m: float) -> Floats:
    return np.array(position_m)


@given(yaw=ANGLES, pitch=ANGLES, roll=ANGLES)
def test_to_the_sensor_and_back_is_the_identity(yaw: float, pitch: float, roll: float) -> None:
    pose = Pose(at(0.1, -0.2, 0.05), rotation(yaw, pitch, roll))
    assert np.linalg.det(pose.rotation) == pytest.approx(1)
    markers_m = markers_at(WORLD)
    seen_m = pose.to_sensor(markers_m)
    assert pose.to_world(seen_m) == pytest.approx(markers_m)
    ranges_m = np.linalg.norm(markers_m - pose.position_m, axis=1)
    assert np.linalg.norm(seen_m, axis=1) == pytest.approx(ranges_m)


def test_a_sensor_that_turns_right_sees_what_is_ahead_on_its_left() -> None:
    ahead = at(0, 0, 1)
    quarter = math.pi / 2
    assert Pose(at(0, 0, 0), rotation(quarter, 0, 0)).to_sensor(ahead) == pytest.approx([-1, 0, 0])
    # y is down: looking up leaves it below.
    assert Pose(at(0, 0, 0), rotation(0, quarter, 0)).to_sensor(ahead) == pytest.approx([0, 1, 0])


def test_yaw_is_the_angle_by_which_a_marker_faces_away() -> None:
    marker_m = at(0, 0, 1)
    assert yaw_of(marker_m, Pose(at(0, 0, 0), NO_TURN)) == pytest.approx(0)
    assert yaw_of(marker_m, Pose(at(0, 0, 0.5), rotation(1, 2, 3))) == pytest.approx(0)
    assert yaw_of(marker_m, Pose(at(0, 1, 0), NO_TURN)) == pytest.approx(math.pi / 4)


def test_all_are_seen_within_the_border_and_in_zones_of_their_own() -> None:
    grid = ZoneGrid()
    middles = np.append(grid.tangents, np.ones((grid.zones, 1)), axis=1)
    assert sees_all(middles, grid)
    assert sees_all(2 * middles, grid)
    assert not sees_all(-middles, grid)
    assert not sees_all(middles * [1.2, 1, 1], grid)
    assert not sees_all(middles[[0, 0, 1]], grid)


def test_from_its_own_place_the_sensor_sees_about_the_shipped_scene() -> None:
    scene = view_from(Pose(at(0, 0, 0), NO_TURN), WORLD, np.random.default_rng(0))
    assert markers_at(scene) == pytest.approx(markers_at(WORLD))
    shown, shipped = (
        {zone: (one.distance_m, one.signal) for one in view.surfaces for zone in one.zones or ()}
        for view in (scene, WORLD)
    )
    assert sorted(shown) == list(range(16))
    for zone, (distance_m, signal) in shipped.items():
        assert shown[zone][1] == signal
        assert shown[zone][0] == pytest.approx(distance_m, abs=0.01)
    assert all(marker.start_s <= 0 and abs(marker.yaw_rad) < 1e-6 for marker in scene.markers)


def test_the_hand_sees_all_from_every_place() -> None:
    rng = np.random.default_rng(4)
    for _ in range(20):
        pose = random_pose(WORLD, rng)
        scene = view_from(pose, WORLD, rng)
        assert sees_all(markers_at(scene), WORLD.sensor.grid)
        assert pose.to_world(markers_at(scene)) == pytest.approx(markers_at(WORLD))
        covered = [zone for one in scene.surfaces for zone in one.zones or ()]
        assert set(covered) == set(range(16))


def test_errors_of_a_place() -> None:
    found = place(zone_bearing(5, ZoneGrid()), 1.5, 0.002)
    right = place_error(found, found.position_m)
    assert right == pytest.approx(PlaceError(0, 0, 0, 0), abs=1e-6)
    farther = place_error(found, found.position_m * 1.53 / 1.5)
    assert farther.range_m == pytest.approx(-0.03)
    assert farther.position_m == pytest.approx(0.03)
    assert farther.bearing_deg == pytest.approx(0, abs=1e-6)
    behind = place_error(found, -found.position_m)
    assert behind.bearing_deg == pytest.approx(180)


def test_how_many_ellipsoids_hold() -> None:
    assert held([]) is None
    share = held([0.1, 7.0, 9.0])
    assert share is not None
    assert (share['hits'], share['trials']) == (2, 3)


def test_frames_one_by_one_give_each_reading_as_soon_as_all_of_it_was_seen() -> None:
    recording = Simulation(WORLD).run(4)
    readings = list(read_live(new_detector('joint', recording.grid), recording))
    assert {one.detection.id for one in readings} == {one.id for one in WORLD.markers}
    for known_ns, detection in readings:
        assert known_ns in recording.stamp_ns
        assert detection.start_ns < detection.stamp_ns < detection.end_ns
        assert 0 <= known_ns - detection.end_ns < 0.5e9


def test_quick_trials_place_all_objects() -> None:
    figures = coffee.run(np.random.default_rng(1), quick=True)
    low_m, high_m = figures['ranges_m']
    assert 0.7 < low_m < high_m < 2.4
    joint = figures['methods']['joint']
    assert joint['placed']['hits'] == figures['trials']
    assert joint['wrong_ids'] == 0
    # No sooner than a packet lasts, and no later than a few.
    assert 1.2 < joint['times_s'][0] <= joint['mean_s'] < 3
    for errors in joint['objects'].values():
        assert len(errors['range_mm']) == figures['trials']
        assert np.abs(errors['range_mm']).max() < 30
        assert max(errors['bearing_deg']) < 12
    assert len(joint['offsets_mm']) == 3


def test_objects_that_are_not_read_are_not_placed() -> None:
    rng = np.random.default_rng(2)
    pose = random_pose(WORLD, rng)
    scene = view_from(pose, WORLD, rng)
    recording = Simulation(replace(scene, markers=scene.markers[:2]), rng).run(4)
    outcome = coffee.place_all('joint', recording, scene, pose)
    assert outcome.time_s == math.inf
    assert set(outcome.errors) == {marker.name for marker in scene.markers[:2]}
    assert len(outcome.offset_errors_m) == 1


def test_the_drone_is_where_the_demo_says() -> None:
    scene = load_scene('drone')
    (marker,) = scene.markers
    recording = Simulation(scene).run(6)
    readings = list(read_live(new_detector('joint', recording.grid), recording))
    assert readings
    for _, detection in readings:
        place_m = drone.true_place(marker, detection)
        since_ns = np.array([float(detection.stamp_ns - recording.stamp_ns[0])])
        (range_m,) = true_range(scene, marker, recording, since_ns)
        assert np.linalg.norm(place_m) == pytest.approx(range_m, abs=1e-5)
        assert abs(place_error(detection.place, place_m).range_m) < 0.01


def test_the_drone_drifts_over_more_than_20_cm_and_four_zones() -> None:
    scene = load_scene('drone')
    moved = drone.motion(scene, scene.duration_s)
    assert moved['span_m'][0] > 0.2
    assert moved['span_m'][1] > 0.2
    assert moved['zones'] == [5, 6, 9, 10]
    assert moved['crossings'] > 20


def reading_at(known_s: float) -> drone.Reading:
    somewhere = place(zone_bearing(5, ZoneGrid()), 1.0, 0.001)
    return drone.Reading(known_s, known_s - 0.65, somewhere, PlaceError(0, 0, 0, 0))


def test_heartbeats_and_silences_of_a_run() -> None:
    readings = [reading_at(time_s) for time_s in (3.0, 9.5, 31.0)]
    heartbeat = drone.heartbeat_of(readings, 40.0, 10.0)
    assert (heartbeat.windows_alive, heartbeat.windows) == (2, 4)
    assert drone.silences(readings, 40.0) == [3.0, 6.5, 21.5, 9.0]
    assert heartbeat.longest_silence_s(40.0) == max(drone.silences(readings, 40.0))
    assert drone.silences([], 40.0) == [40.0]


@pytest.mark.parametrize('name', ['coffee', 'drone'])
def test_use_cases_write_figures_and_a_chart(
    name: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Too short for much: what was never read must not break table or chart.
    monkeypatch.setattr(coffee, '_QUICK_TRIALS', 1)
    monkeypatch.setattr(coffee, 'TIMEOUT_S', 1.5)
    monkeypatch.setattr(drone, '_QUICK_DURATION_S', 11.0)
    assert name in EXPERIMENTS
    run_experiments([name], tmp_path, quick=True)
    figures = json.loads(
        (tmp_path / f'{name}.json').read_text(), parse_constant=lambda word: pytest.fail(word)
    )
    assert 'joint' in figures['methods']
    assert (tmp_path / f'{name}.png').read_bytes().startswith(b'\x89PNG')
    assert 'joint' in capsys.readouterr().out
