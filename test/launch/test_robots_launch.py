# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Two emulated robots in one launch, by namespaces that are pushed: one process each, and two."""

import os
import signal
import sys
import tempfile
import time
import unittest
from pathlib import Path
from typing import ClassVar

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')

import launch_testing
from launch.actions import GroupAction
from launch_ros.actions import PushRosNamespace

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness import check_detections, wait_for_readings, wait_for_traffic
from harness_launch import check_exit_codes, included, launched
from harness_observer import Observer

from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.scene.files import load_scene

SCENE = load_scene('coffee')
IDS = {marker.id for marker in SCENE.markers}
FRAME_ID = 'retrolidar_optical_frame'
ROBOTS = {'robot1': 'false', 'robot2': 'true'}
"""Whether each has driver and detector in a single process."""
PARAMETERS = """
/**:
  ros__parameters:
    qos_overrides./robot1/retrolidar/points.publisher.reliability: best_effort
"""


def read_since(observer, time_ns):
    """Return the IDs of packets that began after a time."""
    return {one.id for one, _ in observer.markers if to_ns(one.start) > time_ns}


@pytest.mark.launch_test
def generate_test_description():
    parameters = Path(tempfile.mkdtemp()) / 'parameters.yaml'
    parameters.write_text(PARAMETERS)
    robots = []
    for robot, single_process in ROBOTS.items():
        arguments = {
            'emulate': 'coffee',
            'single_process': single_process,
            'params_file': str(parameters),
            'respawn_delay': '0.5',
            'log_level': 'warn',
        }
        include = included('retrolidar', **arguments)
        robots.append(GroupAction([PushRosNamespace(robot), include]))
    return launched(*robots)


class TestRobots(unittest.TestCase):
    """Each is read by itself, and what is killed comes again."""

    observers: ClassVar = {}

    @classmethod
    def tearDownClass(cls):
        for observer in cls.observers.values():
            observer.close()

    def listen(self, robot):
        """Return the observer of a robot, which listens from its first use on."""
        if robot not in self.observers:
            self.observers[robot] = Observer(f'/{robot}/retrolidar')
            wait_for_traffic(self.observers[robot])
        return self.observers[robot]

    def test_both_are_read(self):
        for robot in ROBOTS:
            observer = self.listen(robot)
            wait_for_readings(observer, IDS)
            check_detections(observer, SCENE, FRAME_ID)

    def test_what_is_killed_comes_again(self, proc_info):
        """The nodes of both, by SIGKILL."""
        for robot, name in (('robot1', 'detector'), ('robot1', 'driver'), ('robot2', 'reader')):
            observer = self.listen(robot)
            pids = [info.pid for info in proc_info if info.process_name.startswith(f'{name}-')]
            os.kill(pids[-1], signal.SIGKILL)
            killed_ns = time.time_ns()
            # What was read before may still come.
            observer.wait(lambda o=observer, ns=killed_ns: read_since(o, ns) >= IDS, name)

    def test_qualities_of_service_are_those_of_the_file(self):
        for robot, expected in (('robot1', 'BEST_EFFORT'), ('robot2', 'RELIABLE')):
            topic = f'/{robot}/retrolidar/points'
            node = self.listen(robot).node
            (found,) = node.get_publishers_info_by_topic(topic)
            assert found.qos_profile.reliability.name == expected


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """All processes end in order, but for those that were killed."""

    def test_exit_codes(self, proc_info):
        check_exit_codes(proc_info, -signal.SIGKILL)
