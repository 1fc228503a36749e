# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The launch file of the landmarks: what test/nodes asserts of the node by itself."""

import sys
import tempfile
import unittest
from pathlib import Path

import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')


sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness_landmarks import check_landmarks
from harness_launch import end_test, included, launched

from retrolidar_ros.nodes.listener import Listener

_NAMESPACE = '/launched_landmarks'
_SAVED = Path(tempfile.mkdtemp(prefix='retrolidar_')) / 'room.yaml'


@pytest.mark.launch_test
def generate_test_description():
    # Driver and detector run, but wait for a sensor: what the hand reads is said by the test.
    arguments = {
        'namespace': _NAMESPACE,
        'save_file': str(_SAVED),
        'serial_port': str(_SAVED.parent / 'port'),
    }
    return launched(included('landmarks', **arguments))


class TestLandmarks(unittest.TestCase):
    """The mug is found, moved, saved and forgotten."""

    def test_mug(self):
        listener = Listener(_NAMESPACE)
        self.addCleanup(listener.close)
        check_landmarks(listener, _NAMESPACE, _SAVED)


TestEnd = end_test()
