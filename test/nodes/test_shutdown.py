# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A process of nodes ends at the first signal, whatever it does at that moment."""

import signal
import subprocess
import sys

import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')

PROGRAM = """
import sys, time
from rclpy.node import Node
from retrolidar_ros.nodes.run import run

STAGE = sys.argv[1]

def reached(stage):
    if stage == STAGE:
        print('here', flush=True)
        time.sleep(0.3)

class Stuck(Node):
    def __init__(self):
        reached('creation')
        super().__init__('stuck')
        self.create_timer(0.01, self.tick)

    def tick(self):
        reached('callback')
        if STAGE == 'clean-up':
            print('here', flush=True)

    def destroy_node(self):
        print('destroyed', flush=True)
        super().destroy_node()

sys.exit(run(Stuck))
"""


@pytest.mark.parametrize(
    ('stage', 'number'),
    [
        ('creation', signal.SIGINT),
        ('creation', signal.SIGTERM),
        ('callback', signal.SIGTERM),
        ('callback', signal.SIGHUP),
        ('clean-up', signal.SIGINT),
    ],
)
def test_a_signal_ends_the_process_in_order(stage: str, number: signal.Signals) -> None:
    with subprocess.Popen(
        [sys.executable, '-c', PROGRAM, stage], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        # The middleware may print, too.
        assert b'here\n' in iter(process.stdout.readline, b'')
        process.send_signal(number)
        process.send_signal(signal.SIGINT)  # `ros2 launch` passes on what all have got already
        output, errors = process.communicate(timeout=60)
    assert process.returncode == 0
    assert output.count(b'destroyed') == 1
    assert b'Traceback' not in errors
