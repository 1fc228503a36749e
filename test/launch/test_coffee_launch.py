# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch file of the coffee task: poses in the frame of the sensor, and in that of a base."""

import sys
import unittest
from pathlib import Path

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')

import launch_testing

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness_coffee import BASE_VIEW, SENSOR_VIEW, check_coffee, publish_base
from harness_launch import INTERRUPTED, end_test, included, launched

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene


def _namespace(target_frame):
    return f'/launched_coffee_{target_frame}'.rstrip('_')


@pytest.mark.launch_test
@launch_testing.parametrize('target_frame', ['', BASE_VIEW.frame])
def generate_test_description(target_frame):
    arguments = {
        'emulate': 'coffee',
        'namespace': _namespace(target_frame),
        'target_frame': target_frame,
        'max_stddev': '0.2',
    }
    return launched(included('coffee', **arguments))


class TestCoffee(unittest.TestCase):
    """All objects of the scene are placed, in the frame that is asked for."""

    def test_objects(self, target_frame):
        listener = Listener(_namespace(target_frame))
        self.addCleanup(listener.close)
        if target_frame:
            publish_base(listener)
        view = BASE_VIEW if target_frame else SENSOR_VIEW
        check_coffee(listener, load_scene('coffee'), _namespace(target_frame), view)


TestEnd = end_test(INTERRUPTED)
