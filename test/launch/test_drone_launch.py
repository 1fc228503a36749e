# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch file that watches a drone, with one that falls silent."""

import sys
import tempfile
import unittest
from pathlib import Path

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')

from std_msgs.msg import Bool

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness_launch import INTERRUPTED, end_test, included, launched
from harness_use_cases import (
    Collected,
    Health,
    check_heartbeat,
    impatient_parameters,
    silent_drone,
)

from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.files import load_scene

NAMESPACE = '/launched_drone'
DIRECTORY = Path(tempfile.mkdtemp())
# It is to be read once at least, however long the nodes take to start.
SCENE = silent_drone(DIRECTORY, start_s=3.0, packets=5)


@pytest.mark.launch_test
def generate_test_description():
    arguments = {
        'emulate': str(SCENE),
        'namespace': NAMESPACE,
        'params_file': str(impatient_parameters(DIRECTORY)),
    }
    return launched(included('drone', **arguments))


class TestDrone(unittest.TestCase):
    """It is alive while it is read, and overdue afterwards."""

    def test_heartbeat(self):
        listener = Listener(NAMESPACE)
        self.addCleanup(listener.close)
        alive = Collected(listener, Bool, 'heartbeat/alive')
        health = Health(listener, f'{NAMESPACE}/heartbeat: markers')
        check_heartbeat(listener, alive, health, load_scene(str(SCENE)))


TestEnd = end_test(INTERRUPTED)
