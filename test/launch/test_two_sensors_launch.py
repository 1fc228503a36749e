# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch file of two sensors, which see the same markers."""

import sys
import unittest
from pathlib import Path

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')


sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness_launch import INTERRUPTED, end_test, included, launched
from harness_use_cases import SIDES, check_two_sensors

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.resources import shared_file

NAMESPACE = 'launched_two'


@pytest.mark.launch_test
def generate_test_description():
    arguments = {
        'namespace': NAMESPACE,
        'marker_file': str(shared_file('config/markers.yaml')),
        **{f'{side}_emulate': 'coffee' for side in SIDES},
    }
    return launched(included('two_sensors', **arguments))


class TestTwoSensors(unittest.TestCase):
    """Their detections come on one topic, and no frame of TF has two parents."""

    def test_detections(self):
        listener = Listener(f'/{NAMESPACE}')
        self.addCleanup(listener.close)
        check_two_sensors(listener, load_scene('coffee'), f'/{NAMESPACE}')


TestEnd = end_test(INTERRUPTED)
