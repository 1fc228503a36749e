# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where landmarks are by the readings of them, and a robot among them."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import pytest
from harness_readings import (
    ALONE,
    ERRORS,
    FORWARD,
    GRID,
    HERE,
    SQUARE,
    estimate_of,
    look_round,
    prior_at,
    seen,
    squared,
)

from retrolidar_ros.detector.detection import largest_stddev
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.settings.section import ConfigError
from retrolidar_ros.tasks import survey as survey_module
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.least_squares import Problem
from retrolidar_ros.tasks.localization import robot_pose, room_of
from retrolidar_ros.tasks.reading import Errors, KnownPose, SensorPose, reading
from retrolidar_ros.tasks.survey import Backlog, Survey
from retrolidar_ros.tasks.survey_files import parse_survey

Patch = pytest.MonkeyPatch
Rng = np.random.Generator


@pytest.fixture
def rng() -> Rng:
    return np.random.default_rng(1)


@pytest.fixture
def landmark() -> Landmark:
    """Give one that nothing is known of yet."""
    return Landmark('mug', ALONE, ERRORS)


def look_at(survey: Survey, rng: Rng, name: str = 'mug', marker: int = 7) -> None:
    for index, eye_m in enumerate(SQUARE):
        survey.take(name, seen(HERE, eye_m, rng, stamp_s=index, marker=marker))


def test_four_places_trilaterate_and_the_ellipsoid_is_honest(rng: Rng) -> None:
    distances, errors_m, told_m = [], [], []
    for _ in range(30):
        place_m = HERE + rng.uniform(-0.1, 0.1, 3)
        landmark = Landmark('mug', ALONE, ERRORS)
        look_round(landmark, place_m, rng)
        estimate = estimate_of(landmark)
        distances.append(squared(estimate, place_m))
        errors_m.append(np.linalg.norm(estimate.position_m - place_m))
        told_m.append(estimate.stddev_m)
        assert estimate.readings == 12
        assert estimate.baseline_m == pytest.approx(0.4 * math.sqrt(2))
    assert np.median(errors_m) < 0.003
    assert np.median(told_m) < 0.006
    assert np.mean(np.array(distances) < 7.815) >= 0.9


def test_one_place_gives_no_more_however_often_it_looks(landmark: Landmark, rng: Rng) -> None:
    for stamp_s in range(20):
        landmark.take(seen(HERE, np.zeros(3), rng, stamp_s=stamp_s))
    estimate = estimate_of(landmark)
    zone_m = GRID.pitch * 1.2 / math.sqrt(12)
    assert estimate.stddev_m > 0.75 * zone_m
    assert squared(estimate, HERE) < 7.815
    open_axis = np.linalg.eigh(estimate.covariance[:3, :3])[1][:, -1]
    assert abs(open_axis @ HERE) < 0.2 * np.linalg.norm(HERE)


def test_nothing_is_published_until_two_more_agree_than_do_not(
    landmark: Landmark, rng: Rng
) -> None:
    landmark.take(seen(HERE + np.array([0, 0, 0.5]), np.zeros(3), rng))  # a reflection
    for index, eye_m in enumerate([np.zeros(3), *SQUARE[:2]], start=1):
        assert landmark.estimate() is None
        landmark.take(seen(HERE, eye_m, rng, stamp_s=index))
    estimate = estimate_of(landmark)
    assert squared(estimate, HERE) < 16.27
    assert estimate.moved_s is None
    assert estimate.rejected == 1


def test_ranges_that_are_hardly_known_are_left_out(landmark: Landmark, rng: Rng) -> None:
    for index in range(3):
        one = seen(HERE, np.zeros(3), rng, stamp_s=index)
        landmark.take(one._replace(range_m=one.range_m - 0.35, range_stddev_m=0.05))
    assert landmark.estimate() is None


def test_readings_that_do_not_belong_are_counted_and_change_nothing(
    landmark: Landmark, rng: Rng
) -> None:
    look_round(landmark, HERE, rng)
    before = estimate_of(landmark)
    assert not landmark.take(seen(HERE + np.array([0.5, 0, 0.2]), SQUARE[0], rng, stamp_s=20))
    after = estimate_of(landmark)
    assert after.rejected == before.rejected + 1 == 1
    assert np.array_equal(after.position_m, before.position_m)


def test_what_is_carried_away_is_never_published_between_two_places(rng: Rng) -> None:
    for way in ([0.3, 0.0, 0.0], [0.0, -0.4, 0.3], [-0.2, 0.2, -0.2]):
        landmark = Landmark('mug', ALONE, ERRORS)
        look_round(landmark, HERE, rng)
        there_m = HERE + np.array(way)
        for index in range(4):
            landmark.take(seen(there_m, SQUARE[index % 2], rng, stamp_s=30 + index))
            estimate = estimate_of(landmark)
            assert min(squared(estimate, HERE), squared(estimate, there_m)) < 16.27
        assert estimate_of(landmark).moved_s == 32
        assert squared(estimate_of(landmark), there_m) < 16.27
        # What was read before it was moved comes late, and is too late.
        assert not landmark.take(seen(HERE, SQUARE[2], rng, stamp_s=12.5))


def test_a_landmark_of_a_former_survey_is_known_until_it_is_found_elsewhere(rng: Rng) -> None:
    landmark = Landmark('mug', ALONE, ERRORS, prior_at(HERE, 1e-6, 3.0))
    assert np.array_equal(estimate_of(landmark).position_m, HERE)
    landmark.take(seen(HERE, SQUARE[0], rng, stamp_s=1))
    assert squared(estimate_of(landmark), HERE) < 16.27
    for stamp_s in (2, 3, 4):
        landmark.take(seen(HERE + np.array([0, 0.5, 0]), SQUARE[0], rng, stamp_s=stamp_s))
    assert estimate_of(landmark).moved_s == 4


TRAY = {10 + n: 0.5 * corner for n, corner in enumerate(SQUARE)}
"""Where its markers are on an object."""


def test_an_object_of_four_markers_has_an_orientation(rng: Rng) -> None:
    turn = matrix_of_turn(np.array([0.2, -0.3, 0.4]))
    landmark = Landmark('tray', TRAY, ERRORS)
    for index, (eye_m, marker) in enumerate(itertools.product(SQUARE, TRAY)):
        place_m = HERE + turn @ TRAY[marker]
        landmark.take(seen(place_m, eye_m, rng, marker=marker, stamp_s=index))
    estimate = estimate_of(landmark)
    off = estimate.rotation @ turn.T
    assert math.degrees(math.acos(min((np.trace(off) - 1) / 2, 1))) < 3
    assert squared(estimate, HERE) < 16.27
    assert np.sqrt(np.diag(estimate.covariance)[3:]).max() < 0.1


def test_an_object_of_which_one_marker_is_seen_says_that_its_turn_is_open(rng: Rng) -> None:
    landmark = Landmark('tray', TRAY, ERRORS)
    for stamp_s in range(2):
        landmark.take(seen(HERE, np.zeros(3), rng, marker=10, stamp_s=stamp_s))
    assert np.sqrt(np.linalg.eigvalsh(estimate_of(landmark).covariance[3:, 3:])[-1]) > 1


def test_a_moving_marker_before_three_sensors(rng: Rng) -> None:
    eyes = [0.25 * np.array([math.cos(a), math.sin(a), 0]) for a in (0.0, 2.1, 4.2)]
    errors = Errors(range_bias_m=1e-4, pose_m=1e-4, turn_rad=1e-4, acceleration=0.01)
    landmark = Landmark('drone', ALONE, errors)
    off_m = []

    def at(time_s: float) -> Floats:
        return np.array([-0.1 + 0.02 * time_s, 0.05, 1.1])

    for step in range(40):
        time_s = 0.4 * step
        landmark.take(seen(at(time_s), eyes[step % 3], rng, stamp_s=time_s, sensor=str(step % 3)))
        if step > 20:
            estimate = estimate_of(landmark)
            # When the last of the sensors has reported where it was.
            assert estimate.stamp_s == pytest.approx(time_s - 0.8)
            off_m.append(estimate.position_m - at(estimate.stamp_s))
            assert squared(estimate, at(estimate.stamp_s)) < 16.27
    assert np.sqrt(np.mean(np.sum(np.square(off_m), axis=1))) < 0.015
    assert estimate_of(landmark).velocity == pytest.approx([0.02, 0, 0], abs=0.02)


def test_a_name_stays_with_its_marker_once_that_is_placed(rng: Rng) -> None:
    survey = Survey({}, ERRORS)
    survey.take('mug', seen(HERE, SQUARE[0], rng, marker=9))  # alone, it may be the wrong one
    look_at(survey, rng)
    before = estimate_of(survey.landmarks['mug'])
    with pytest.raises(ValueError, match='two markers have one name'):
        survey.take('mug', seen(HERE, SQUARE[0], rng, marker=8, stamp_s=9))
    assert estimate_of(survey.landmarks['mug']) is before


def test_a_survey_is_limited_and_prefers_what_is_placed(rng: Rng, monkeypatch: Patch) -> None:
    monkeypatch.setattr(survey_module, 'MAX_LANDMARKS', 5)
    survey = Survey({}, ERRORS)
    look_at(survey, rng)
    for index in range(8):
        survey.take(f'flood {index}', seen(HERE, SQUARE[0], rng, stamp_s=9))
    assert len(survey.landmarks) == 5
    assert estimate_of(survey.landmarks['mug']).readings == 4


def test_after_a_restart_only_the_former_survey_is_known(rng: Rng) -> None:
    survey = Survey({}, ERRORS, {'mug': prior_at(HERE, 1e-4, 1e-4)})
    look_at(survey, rng)
    look_at(survey, rng, 'jar', marker=8)
    survey.restart()
    (mug,) = survey.estimates()
    assert (mug.name, mug.readings) == ('mug', 0)
    assert np.array_equal(mug.position_m, HERE)


def test_readings_that_cannot_be_solved_change_nothing(rng: Rng, monkeypatch: Patch) -> None:
    survey = Survey({}, ERRORS)
    look_at(survey, rng)
    before = estimate_of(survey.landmarks['mug'])

    def fail(*_: object) -> None:
        raise np.linalg.LinAlgError('Singular matrix')

    monkeypatch.setattr(Problem, 'solve', fail)
    with pytest.raises(ValueError, match='readings that cannot be solved: mug'):
        survey.take('mug', seen(HERE, SQUARE[0], rng, stamp_s=9))
    monkeypatch.undo()
    assert estimate_of(survey.landmarks['mug']) is before
    survey.take('mug', seen(HERE, SQUARE[0], rng, stamp_s=9))
    assert estimate_of(survey.landmarks['mug']).readings == 5


def test_readings_together_say_what_they_say_one_by_one(rng: Rng) -> None:
    singly, together = Survey({}, ERRORS), Survey({}, ERRORS)
    far = HERE + np.array([0, 0, 0.5])
    readings = [
        seen(far if index % 7 == 6 else HERE, SQUARE[index % 4], rng, stamp_s=index)
        for index in range(36)
    ]
    for one in readings:
        singly.take('mug', one)
    for index in range(0, 36, 4):
        together.take('mug', *readings[index : index + 4])
    first, second = (estimate_of(survey.landmarks['mug']) for survey in (singly, together))
    assert (first.readings, first.rejected) == (second.readings, second.rejected) == (31, 5)
    assert first.position_m == pytest.approx(second.position_m, abs=1e-4)
    assert first.stddev_m == pytest.approx(second.stddev_m, rel=0.02)


def test_an_estimate_does_not_depend_on_where_it_starts(landmark: Landmark, rng: Rng) -> None:
    readings = [seen(HERE, SQUARE[index % 2], rng, stamp_s=index) for index in range(30)]
    readings += [readings[-1]._replace(stamp_s=30.0 + index) for index in range(60)]
    for one in readings:
        landmark.take(one)
    alone = Problem(ALONE, tuple(landmark.members), ERRORS).solve()
    estimate = estimate_of(landmark)
    assert estimate.position_m == pytest.approx(alone.state.position_m, abs=1e-3)
    assert estimate.stddev_m == pytest.approx(largest_stddev(alone.covariance[:3, :3]), rel=0.02)


@pytest.mark.parametrize(
    ('key', 'value', 'message'),
    [
        ('position', [1.0, 2.0], r'landmarks\.mug\.position: needs a list of 3 numbers'),
        ('orientation', [0, 0, 0, 0], 'is no quaternion'),
        ('covariance', [0.0] * 36, 'is not symmetric and above 0'),
        ('covariance', ['x'] * 36, 'needs a list of 36 numbers'),
        ('position', [0, 0, 10**400], 'needs a list of 3 numbers, not .{200}$'),
    ],
)
def test_an_impossible_survey_is_refused(key: str, value: object, message: str) -> None:
    mug = {'position': [0, 0, 1], 'orientation': [0, 0, 0, 1], 'covariance': list(np.eye(6).flat)}
    with pytest.raises(ConfigError, match=message):
        parse_survey({'frame': 'map', 'landmarks': {'mug': mug | {key: value}}})


@pytest.mark.parametrize('spoilt', [np.full((3, 3), math.nan), np.zeros((3, 3)), 2 * np.eye(3)])
def test_a_sensor_without_a_pose_is_refused(spoilt: Floats) -> None:
    with pytest.raises(ValueError, match='the transform of the sensor is no pose'):
        reading(7, 'hand', 0.0, 1.3, 0.001, HERE, np.eye(3), SensorPose(HERE, spoilt))


def known_room(
    survey: Sequence[tuple[int, Floats]],
) -> tuple[dict[str, KnownPose], dict[str, dict[int, Floats]]]:
    known = {str(one): prior_at(at, 1e-6, 3.0) for one, at in survey}
    return known, {str(one): {one: np.zeros(3)} for one, _ in survey}


def test_a_robot_finds_itself_among_four_markers(rng: Rng) -> None:
    walls = [(1, [2, 0.4, 0.3]), (2, [-0.3, 2, -0.2]), (3, [-2, -0.5, 0.1]), (4, [0.6, -2, 0.4])]
    places = [(one, np.array(place)) for one, place in walls]
    room = room_of(*known_room(places), ERRORS, flat=True)
    base_m, base = np.array([0.3, -0.2, 0.0]), matrix_of_turn(np.array([0, 0, 0.7]))
    for step in range(48):
        turn = matrix_of_turn(np.array([0, 0, math.radians(15 * (step % 24))])) @ FORWARD
        for marker, place_m in places:
            own = (place_m - base_m) @ base @ turn
            if own[2] > 0.5 and np.abs(own[:2]).max() < 0.4 * own[2]:
                there = base.T @ (place_m - base_m)
                room.take(seen(there, np.zeros(3), rng, marker=marker, stamp_s=step, rotation=turn))
    pose = robot_pose(estimate_of(room), np.zeros(3), np.eye(3))
    assert pose is not None
    assert np.linalg.norm(pose.position_m - base_m) < 0.015
    turned = pose.rotation @ base.T
    assert math.degrees(abs(math.atan2(turned[1, 0], turned[0, 0]))) < 1
    assert squared(pose, base_m) < 16.27


def test_no_pose_is_published_where_the_robot_is_not(rng: Rng) -> None:
    places = [(one, np.array([2.0, 0.5 * one - 1, 0.0])) for one in range(1, 4)]
    room = room_of(*known_room(places), ERRORS, flat=True)
    poses = []
    # Three readings of one marker, which put it on a circle, and then the others.
    for index, (marker, place_m) in enumerate([*places[:1] * 3, *places[1:]]):
        room.take(seen(place_m, np.zeros(3), rng, marker=marker, stamp_s=index, rotation=FORWARD))
        estimate = room.estimate()
        poses.append(None if estimate is None else robot_pose(estimate, np.zeros(3), np.eye(3)))
    assert poses[:3] == [None] * 3
    assert poses[-1] is not None
    assert all(pose is None or squared(pose, np.zeros(3)) < 16.27 for pose in poses[3:])


def test_a_room_needs_three_markers() -> None:
    with pytest.raises(ValueError, match='localisation needs three'):
        room_of(*known_room([(1, HERE), (2, HERE + 1)]), ERRORS)


def test_who_waits_longest_is_next_with_the_newest_of_its_readings(rng: Rng) -> None:
    backlog = Backlog()
    for index in range(30):
        for name in ('mug', 'jar')[index > 0 :]:
            backlog.add(name, seen(HERE, SQUARE[0], rng, stamp_s=index), now_s=0.1 * index)
    assert backlog.dropped == 22
    assert len(backlog) == 9
    mug, jar = backlog.pop(), backlog.pop()
    assert (mug.name, [one.stamp_s for one in mug.readings]) == ('mug', [0])
    assert (jar.name, [one.stamp_s for one in jar.readings]) == ('jar', list(range(22, 30)))
    assert jar.since_s == 0.0
    assert not backlog
