# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a new user starts first: an emulated arm that reaches its goal by itself, and RViz."""

import os
import sys
import tempfile
import unittest
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import yaml

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')

import launch_testing
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from launch import LaunchContext
from launch.launch_description_sources import get_launch_description_from_any_launch_file
from launch.utilities import perform_substitutions
from launch_ros.actions import Node
from std_msgs.msg import Bool, String

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness import MAX_MAHALANOBIS
from harness_launch import (
    check_at_once,
    check_exit_codes,
    domain_of,
    in_domain,
    included,
    launched,
    observer_in,
)

from retrolidar_ros.nodes.conversion import covariance_of, to_ns, vector_of
from retrolidar_ros.nodes.emulated_arm import IN_BASE
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.resources import shared_file

ARM = load_scene('arm')
WANTED_M = 0.01
MINUTE_S = 60.0


def pretend_that_rviz_is_installed():
    """Make a package `rviz2` that is found in this process."""
    directory = Path(tempfile.mkdtemp(prefix='retrolidar_'))
    index = directory / 'share' / 'ament_index' / 'resource_index' / 'packages' / 'rviz2'
    executable = directory / 'lib' / 'rviz2' / 'rviz2'
    for path in (index, executable):
        path.parent.mkdir(parents=True)
        path.touch(0o755)
    return patch.dict(
        os.environ, {'AMENT_PREFIX_PATH': f'{directory}:{os.environ["AMENT_PREFIX_PATH"]}'}
    )


def topics_of(file):
    displays = yaml.safe_load(file.read_text())['Visualization Manager']['Displays']
    places = [one.get('Topic', one.get('Description Topic', {})) for one in displays]
    return {place['Value'] for place in places if place}


def shown_by(name, **arguments):
    """Return the file that a launch file has RViz show; nothing is started."""
    file = str(shared_file(f'launch/{name}.launch.py'))
    context = LaunchContext()
    context.launch_configurations.update(arguments, rviz='true')
    entities = get_launch_description_from_any_launch_file(file).entities
    actions = [action for one in entities for action in one.execute(context) or []]
    (rviz,) = [one for one in actions if isinstance(one, Node) and one.node_executable == 'rviz2']
    words = [perform_substitutions(context, part) for part in rviz.cmd]
    return Path(words[words.index('-d') + 1])


def check_poses(observer, node):
    """All objects get to a centimetre within a minute, and are where they are."""
    truth = {one.name: IN_BASE @ np.array(one.position_m) for one in ARM.markers}
    poses = {
        name: observer.collect(PoseWithCovarianceStamped, f'{node}/objects/{name}')
        for name in truth
    }

    def are_known():
        last = [covariance_of(one[-1].pose)[:3, :3] for one in poses.values() if one]
        spread = [np.sqrt(np.linalg.eigvalsh(one)[-1]) for one in last]
        return len(spread) == len(truth) and max(spread) <= WANTED_M

    observer.wait(are_known, 'objects that are known to a centimetre', MINUTE_S)
    for name, came in poses.items():
        assert came[-1].header.frame_id == 'base_link'
        off = vector_of(came[-1].pose.pose.position) - truth[name]
        covariance = covariance_of(came[-1].pose)[:3, :3]
        assert off @ np.linalg.solve(covariance, off) < MAX_MAHALANOBIS, name


def check_coffee(observer):
    ready = observer.collect(Bool, 'coffee/ready')
    views = observer.collect(PoseStamped, 'coffee/next_view')
    missing = observer.collect(String, 'coffee/missing')
    check_poses(observer, 'coffee')
    observer.wait(lambda: ready[-1].data and not missing[-1].data, 'coffee that is ready')
    assert views
    # The reach is around the place of the first reading; the arm does not stand there.
    first_ns = to_ns(views[0].header.stamp)
    places = np.array(
        [
            vector_of(one.transform.translation)
            for one in observer.transforms
            if one.child_frame_id == 'retrolidar_optical_frame'
            and to_ns(one.header.stamp) <= first_ns
        ]
    )
    for view in views:
        assert view.header.frame_id == 'base_link'
        apart_m = np.linalg.norm(vector_of(view.pose.position) - places, axis=1)
        assert apart_m.min() < 0.5 + 0.02
    stamps = np.array([one.header.stamp.sec for one in views])
    assert len(views) < 12, stamps  # not with every reading


CASES = {
    'landmarks': (domain_of(0), lambda observer: check_poses(observer, 'landmarks')),
    'coffee': (domain_of(1), check_coffee),
}


@pytest.mark.launch_test
def generate_test_description():
    arms = []
    for case, (domain, _) in CASES.items():
        arm = included(case, emulate='arm', namespace=f'emulated_{case}')
        arms.append(in_domain(domain, arm))
    return launched(*arms)


class TestLaunchFiles(unittest.TestCase):
    """The arm reaches its goal, and RViz gets a file of the right topics."""

    def test_both(self):
        observers = {}
        for case, (domain, _) in CASES.items():
            observers[case] = observer_in(domain, f'/emulated_{case}')
            self.addCleanup(observers[case].close)
        check_at_once(self, {case: CASES[case][1] for case in CASES}, observers)

    def test_every_launch_file_shows_its_topics_in_its_frame(self):
        of_sensor = {'points', 'marker_array', 'signal_image'}
        both = {f'{side}/{one}' for side in ('left', 'right') for one in of_sensor}
        arm = {*of_sensor, 'robot_description'}
        for name, arguments, topics, frame in (
            ('retrolidar', {'frame_id': 'gripper'}, of_sensor, 'gripper'),
            ('coffee', {'emulate': 'arm'}, arm, 'base_link'),
            ('landmarks', {}, {*arm, 'landmarks/marker_array'}, 'base_link'),
            ('two_sensors', {}, both, 'left_optical_frame'),
            ('hall', {'ports': '[/a, /b]', 'names': '[left, right]'}, both, 'left_optical_frame'),
        ):
            with self.subTest(name=name), pretend_that_rviz_is_installed():
                file = shown_by(name, namespace='shown', **arguments)
                assert topics_of(file) == {f'/shown/{one}' for one in topics}
                assert f'Fixed Frame: {frame}\n' in file.read_text()


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """All processes end in order."""

    def test_exit_codes(self, proc_info):
        check_exit_codes(proc_info)
