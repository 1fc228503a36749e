# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A host of a hall: two sensors in one process, found by a discovery server."""

import os
import sys
import tempfile
import unittest
from pathlib import Path

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')


sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness import PATIENCE_S, Sensor
from harness_launch import INTERRUPTED, end_test, included, launched

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene

DIRECTORY = Path(tempfile.mkdtemp())
SERVER = '127.0.0.1:11899'
IDS = {'left': {2073, 2096, 2107}, 'right': {2127}}


@pytest.mark.launch_test
def generate_test_description():
    arguments = {
        'serve': 'true',
        'server': SERVER,
        'ports': str([str(DIRECTORY / name) for name in IDS]),
        'names': str(list(IDS)),
        'namespace': 'hall',
        'markers': '/hall/markers',
    }
    return launched(included('hall', **arguments))


class TestHall(unittest.TestCase):
    """Detections of both come on one topic, each in the frame of its sensor."""

    def test_detections(self):
        os.environ['ROS_DISCOVERY_SERVER'] = SERVER
        listener = Listener('/hall')
        self.addCleanup(listener.close)

        def read():
            found = {name: set() for name in IDS}
            for message, _ in listener.markers:
                found[message.header.frame_id.removesuffix('_optical_frame')].add(message.id)
            return found

        left = Sensor(load_scene('coffee'), DIRECTORY / 'left')
        right = Sensor(load_scene('drone'), DIRECTORY / 'right')
        with left, right:
            assert listener.spin_until(lambda: read() == IDS, PATIENCE_S), read()


TestEnd = end_test(INTERRUPTED)
