# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch file of the drone with three sensors on the ground, which place it."""

import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')


sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness_landmarks import check_drone
from harness_launch import INTERRUPTED, end_test, included, launched
from harness_use_cases import silent_drone

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene

NAMESPACE = '/launched_three'
# It hangs still, for the test does not know when the scene began.
SCENE = silent_drone(Path(tempfile.mkdtemp()), start_s=0.2, packets=1000)


@pytest.mark.launch_test
def generate_test_description():
    arguments = {
        'emulate': str(SCENE),
        'namespace': NAMESPACE,
        'sensors': '3',
        'single_process': 'true',
    }
    return launched(included('drone', **arguments))


class TestDrone(unittest.TestCase):
    """Its place is published in the frame of the triangle."""

    def test_position(self):
        listener = Listener(NAMESPACE)
        self.addCleanup(listener.close)
        (drone,) = load_scene(str(SCENE)).markers
        check_drone(listener, NAMESPACE, lambda _: np.array(drone.position_m))


TestEnd = end_test(INTERRUPTED)
