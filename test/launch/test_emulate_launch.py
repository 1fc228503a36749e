# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch file with an emulated sensor, and with a parameter file of one's own."""

import sys
import tempfile
import unittest
from pathlib import Path

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')


sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness import check_detections, wait_for_nodes, wait_for_readings, wait_for_traffic
from harness_launch import INTERRUPTED, end_test, included, launched

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene

FRAME_ID = 'gripper_lidar'


@pytest.mark.launch_test
def generate_test_description():
    parameters = Path(tempfile.mkdtemp()) / 'parameters.yaml'
    parameters.write_text(f'/**/driver:\n  ros__parameters:\n    frame_id: {FRAME_ID}\n')
    arguments = {'emulate': 'coffee', 'params_file': str(parameters), 'namespace': 'emulated'}
    return launched(included('retrolidar', **arguments))


class TestEmulated(unittest.TestCase):
    """All markers of the scene are read, in the frame that the parameter file names."""

    def test_markers(self):
        scene = load_scene('coffee')
        listener = Listener('/emulated')
        self.addCleanup(listener.close)
        wait_for_nodes(listener)
        wait_for_traffic(listener)
        wait_for_readings(listener, {marker.id for marker in scene.markers})
        check_detections(listener, scene, FRAME_ID)


TestEnd = end_test(INTERRUPTED)
