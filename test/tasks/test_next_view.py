# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
import math

import numpy as np
import pytest
from harness_readings import ALONE, ERRORS, HERE, estimate_of, seen

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.next_view import ViewPlanner, best_place
from retrolidar_ros.tasks.reading import Reading, SensorPose

FAR_M = HERE + np.array([0.2, 0.1, 0.9])


class Hand:
    """Reads objects from places, and asks where to go."""

    def __init__(self, max_stddev_m: float = 1e-4, **places_m: Floats) -> None:
        self.planner = ViewPlanner()
        self.planner.reach_m, self.planner.move_s = 0.3, 8.0
        self.planner.max_stddev_m = max_stddev_m
        self.places_m = places_m
        self.landmarks = {name: Landmark(name, ALONE, ERRORS) for name in places_m}
        self.rng = np.random.default_rng(9)

    def look(self, name: str, eye_m: Floats, stamp_s: float, known: tuple[str, ...] = ()) -> None:
        """Read an object from a place; some others are known well enough."""
        reading: Reading = seen(self.places_m[name], eye_m, self.rng, stamp_s=stamp_s)
        self.landmarks[name].take(reading)
        missing = {
            one: mark if mark.members else None
            for one, mark in self.landmarks.items()
            if one not in known
        }
        self.planner.take(reading, name, missing)

    def look_twice(self) -> None:
        """Read each object twice from the first place; once could be chance."""
        for stamp_s in (0.0, 1.0):
            assert self.planner.view is None
            for name in self.landmarks:
                self.look(name, np.zeros(3), stamp_s)

    @property
    def view(self) -> SensorPose:
        assert self.planner.view is not None
        return self.planner.view


def test_the_best_place_is_the_one_that_helps() -> None:
    rng = np.random.default_rng(9)
    mug, jar = Landmark('mug', ALONE, ERRORS), Landmark('jar', ALONE, ERRORS)
    assert best_place([mug], np.zeros(3), 0.3) is None
    for index, eye_x in enumerate((-0.2, 0.2, -0.2, 0.2)):
        mug.take(seen(HERE, np.array([eye_x, 0.0, 0.0]), rng, stamp_s=index))
    eye_m = best_place([mug, jar], np.zeros(3), 0.3)
    assert eye_m is not None
    assert np.linalg.norm(eye_m) == pytest.approx(0.3)
    # Along x it has looked from two places; so it is to go along y.
    assert abs(eye_m[1]) > 0.15
    assert abs(eye_m[0]) < 0.1
    before_m = estimate_of(mug).stddev_m
    for index in range(2):
        mug.take(seen(HERE, eye_m, rng, stamp_s=10 + index))
    assert estimate_of(mug).stddev_m < before_m / 2
    # It does not go where the object is.
    assert best_place([mug], HERE, 0.2) is None


def test_the_next_viewpoint_keeps_still_until_the_hand_was_there_or_had_time_to_go() -> None:
    hand = Hand(mug=HERE, jar=FAR_M)
    hand.look_twice()
    first_m = hand.view.position_m
    for stamp_s in (2.0, 4.0, 6.0):  # on its way
        hand.look('mug', stamp_s / 8 * first_m, stamp_s)
        assert np.array_equal(hand.view.position_m, first_m)
    hand.look('mug', first_m, 7.4)
    assert np.array_equal(hand.view.position_m, first_m)  # the jar was not read there yet
    hand.look('jar', first_m, 7.8)
    second_m = hand.view.position_m
    assert not np.array_equal(second_m, first_m)
    hand.look('mug', first_m, 15.0)
    assert np.array_equal(hand.view.position_m, second_m)
    view = hand.view
    hand.look('mug', first_m, 16.0)  # it does not come there
    assert hand.planner.view is not view


def test_a_viewpoint_is_given_up_when_its_objects_are_known() -> None:
    hand = Hand(mug=HERE)
    hand.look_twice()
    assert hand.view
    hand.look('mug', np.zeros(3), 2.0, known=('mug',))
    assert hand.planner.view is None


def test_a_viewpoint_is_within_reach_and_heights_and_looks_at_the_objects() -> None:
    hand = Hand(mug=HERE, jar=FAR_M)
    hand.planner.heights_m = (-0.1, 0.05)
    hand.look_twice()
    for stamp_s in range(10, 100, 9):
        hand.look('mug', hand.view.position_m, stamp_s)
        view = hand.view
        assert np.linalg.norm(view.position_m) <= 0.3 + 1e-9
        assert -0.1 <= view.position_m[2] <= 0.05
        assert np.allclose(view.rotation @ view.rotation.T, np.eye(3))
        assert np.linalg.det(view.rotation) == pytest.approx(1)
        in_sensor = view.rotation.T @ (HERE - view.position_m)
        assert np.abs(in_sensor[:2] / in_sensor[2]).max() < 2 * 0.215
        assert view.rotation[0, 0] > 0.8  # not rolled
    hand.planner.heights_m = (5.0, 6.0)
    hand.look('mug', np.zeros(3), 200.0)
    assert hand.planner.view is None


def test_of_objects_too_far_apart_for_one_look_the_one_known_least_is_looked_at() -> None:
    aside_m = np.array([2.0, 0.0, 1.0])
    hand = Hand(mug=HERE, jar=aside_m)
    hand.look_twice()
    hand.look('mug', np.zeros(3), 10.0)
    view = hand.view
    off = view.rotation.T @ (aside_m - view.position_m)
    assert np.abs(off[:2] / off[2]).max() < 0.1
    off = view.rotation.T @ (HERE - view.position_m)
    assert np.abs(off[:2] / off[2]).max() > 1


def test_a_remedy_is_what_would_do() -> None:
    def remedies(max_stddev_m: float, reach_m: float) -> str:
        hand = Hand(max_stddev_m, mug=2 * HERE)
        hand.planner.reach_m = reach_m
        hand.look_twice()
        return hand.planner.remedies.get('mug', '')

    assert remedies(0.05, 0.5) == ''
    told = remedies(0.01, 0.1)
    assert 'with a reach of' in told
    assert remedies(1e-5, 0.5) == 'nearer and from farther apart'
    # What it names suffices.
    reach_m = float(told.partition('with a reach of ')[2].split()[0])
    assert remedies(0.01, reach_m) == ''
    assert not math.isclose(reach_m, 0.1)
