# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a robot is among landmarks, and which readings are kept where more come."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from harness_readings import ERRORS, HERE, SQUARE, estimate_of, prior_at, seen

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of_turn
from retrolidar_ros.tasks.localization import robot_pose, room_of
from retrolidar_ros.tasks.state import Prior
from retrolidar_ros.tasks.survey import Backlog


def known_room(
    survey: Sequence[tuple[int, Floats]],
) -> tuple[dict[str, Prior], dict[str, dict[int, Floats]]]:
    known = {str(one): prior_at(at, 1e-6, 3.0) for one, at in survey}
    return known, {str(one): {one: np.zeros(3)} for one, _ in survey}


def test_a_robot_finds_itself_among_four_markers() -> None:
    rng = np.random.default_rng(11)
    walls = [(1, [2, 0.4, 0.3]), (2, [-0.3, 2, -0.2]), (3, [-2, -0.5, 0.1]), (4, [0.6, -2, 0.4])]
    places = [(one, np.array(place)) for one, place in walls]
    room = room_of(*known_room(places), ERRORS, flat=True)
    base_m, base = np.array([0.3, -0.2, 0.0]), matrix_of_turn(np.array([0, 0, 0.7]))
    forward = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    for step in range(48):
        turn = matrix_of_turn(np.array([0, 0, math.radians(15 * (step % 24))])) @ forward
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
    off = pose.position_m - base_m
    assert off @ np.linalg.solve(pose.covariance[:3, :3], off) < 16.27


def test_no_pose_is_published_where_the_robot_is_not() -> None:
    rng = np.random.default_rng(19)
    places = [(one, np.array([2.0, 0.5 * one - 1, 0.0])) for one in range(1, 4)]
    room = room_of(*known_room(places), ERRORS, flat=True)
    ahead = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    poses = []
    # Three readings of one marker, which put it on a circle, and then the others.
    for index, (marker, place_m) in enumerate([*places[:1] * 3, *places[1:]]):
        room.take(seen(place_m, np.zeros(3), rng, marker=marker, stamp_s=index, rotation=ahead))
        estimate = room.estimate()
        poses.append(None if estimate is None else robot_pose(estimate, np.zeros(3), np.eye(3)))
    assert poses[:3] == [None] * 3
    assert poses[-1] is not None
    for pose in poses[3:]:
        if pose is not None:
            off = pose.position_m
            assert off @ np.linalg.solve(pose.covariance[:3, :3], off) < 16.27


def test_a_room_needs_three_markers() -> None:
    with pytest.raises(ValueError, match='localisation needs three'):
        room_of(*known_room([(1, HERE)]), ERRORS)


def test_who_waits_longest_is_next_with_the_newest_of_its_readings() -> None:
    rng = np.random.default_rng(1)
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
