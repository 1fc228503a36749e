# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch file with a sensor that this test plugs, pulls and disturbs."""

import sys
import tempfile
import unittest
from pathlib import Path

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')


sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness import (
    Sensor,
    check_cable_pull,
    check_corruption,
    check_detections,
    check_frames,
    wait_for_nodes,
    wait_for_readings,
)
from harness_launch import end_test, included, launched

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene

PORT = Path(tempfile.mkdtemp()) / 'port'
FRAME_ID = 'retrolidar_optical_frame'


@pytest.mark.launch_test
def generate_test_description():
    arguments = {'serial_port': str(PORT), 'namespace': 'launched'}
    return launched(included('retrolidar', **arguments))


class TestChain(unittest.TestCase):
    """The assertions that the plain process runner makes, too."""

    def test_chain(self):
        scene = load_scene('coffee')
        listener = Listener('/launched')
        self.addCleanup(listener.close)
        wait_for_nodes(listener)
        with Sensor(scene, PORT) as sensor:
            wait_for_readings(listener, {marker.id for marker in scene.markers})
            check_frames(listener, sensor, FRAME_ID)
            check_detections(listener, scene, FRAME_ID)
            check_cable_pull(listener, sensor)
            check_corruption(listener, sensor, 0.05)


TestEnd = end_test()
