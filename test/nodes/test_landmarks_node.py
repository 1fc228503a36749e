# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The node `landmarks`, started by itself: what test/launch asserts of its launch file."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import yaml
from geometry_msgs.msg import PoseWithCovarianceStamped
from harness_landmarks import CORNERS, FIXED, HAND, MUG_M, Hand, check_landmarks, squared
from harness_nodes import running
from harness_observer import LATCHED, RELIABLE
from tf2_msgs.msg import TFMessage

from retrolidar_ros.nodes.conversion import to_header, to_pose, to_transform, vector_of
from retrolidar_ros.tasks.landmarks import Landmark
from retrolidar_ros.tasks.reading import Errors
from retrolidar_ros.tasks.state import Prior, State
from retrolidar_ros.tasks.survey_files import survey_content


def test_landmarks_are_found_moved_saved_and_forgotten(tmp_path: Path) -> None:
    saved = tmp_path / 'room.yaml'
    with running(tmp_path, '/landmarks_alone') as system:
        system.start('landmarks', save_file=saved)
        check_landmarks(system, saved)


def test_a_robot_is_localised_among_the_landmarks_of_a_file(tmp_path: Path) -> None:
    places = {5: [-0.3, -0.3, 1.5], 6: [0.3, -0.25, 1.2], 8: [0.25, 0.3, 1.4], 9: [-0.3, 0.3, 1.1]}
    estimates = []
    for identity, at in places.items():
        prior = Prior(State(np.array(at), np.eye(3), np.zeros(3)), 1e-6 * np.eye(6))
        estimate = Landmark(f'marker_{identity}', {}, Errors(), prior).estimate()
        assert estimate is not None
        estimates.append(estimate)
    known = tmp_path / 'room.yaml'
    known.write_text(yaml.safe_dump(survey_content('map', estimates)))
    robot_m = np.array([0.02, -0.03, 0.0])
    before = known.read_bytes()
    with running(tmp_path, '/landmarks_robot') as system:
        system.start('landmarks', load_file=known, save_file=known, localize='true')
        poses = system.collect(PoseWithCovarianceStamped, 'landmarks/pose', RELIABLE)
        hand = Hand(system)
        while len(poses) < 6:
            for identity, at in places.items():
                # The hand's own frame is the fixed one here, and the robot is off its origin.
                there_m = np.array(at) - robot_m
                hand.read(f'marker_{identity}', identity, there_m, np.zeros(3))
        pose = poses[-1]
        assert pose.header.frame_id == 'map'
        assert squared(pose, robot_m) < 16.27
        assert np.linalg.norm(vector_of(pose.pose.pose.position) - robot_m) < 0.05
        answer = system.services.trigger('landmarks/save')
        assert not answer.success
        assert 'while localising no map is made' in answer.message
    assert known.read_bytes() == before


def test_no_transform_is_sent_of_a_frame_with_another_parent(tmp_path: Path) -> None:
    with running(tmp_path, '/landmarks_taken') as system:
        system.start('landmarks', child_frame='held_{name}')
        hand = Hand(system)
        mug = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/mug')
        pose = to_pose(MUG_M, np.array([0.0, 0.0, 0.0, 1.0]))
        taken = to_transform(to_header(time.time_ns(), HAND), 'held_mug', pose)
        system.node.create_publisher(TFMessage, '/tf_static', LATCHED).publish(
            TFMessage(transforms=[taken])
        )
        while not mug:
            for corner in CORNERS:
                hand.read('mug', 2107, MUG_M, np.append(corner, 0.0))
        told = f'no transform from {FIXED} to held_mug is sent: its parent in TF is {HAND}'
        system.wait(lambda: told in system.log('landmarks'), 'a refusal')
        system.transforms.clear()
        mug.clear()
        hand.read('mug', 2107, MUG_M, np.append(CORNERS[0], 0.0))
        system.wait(lambda: bool(mug), 'a pose')
        assert not [one for one in system.transforms if one.child_frame_id == 'held_mug']
        assert system.log('landmarks').count(told) == 1
