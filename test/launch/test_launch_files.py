# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Each launch file, with the assertions that test/nodes makes of plain processes."""

import sys
import tempfile
import unittest
from itertools import chain
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')

import launch_testing

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness import (
    PATIENCE_S,
    Sensor,
    check_detections,
    check_frames,
    wait_for_nodes,
    wait_for_readings,
    wait_for_traffic,
)
from harness_coffee import SENSOR_VIEW, check_coffee
from harness_landmarks import check_drone, check_landmarks
from harness_launch import (
    check_at_once,
    check_exit_codes,
    domain_of,
    in_domain,
    included,
    launched,
    observer_in,
)
from harness_use_cases import (
    SIDES,
    check_heartbeat,
    check_two_sensors,
    impatient_parameters,
    silent_drone,
)

from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.settings.resources import shared_file

COFFEE = load_scene('coffee')
IDS = {marker.id for marker in COFFEE.markers}
SERVER = '127.0.0.1:11899'
HALL = {'left': IDS, 'right': {2127}}


def directory():
    return Path(tempfile.mkdtemp(prefix='retrolidar_'))


PORTS, SAVED, OWN = directory(), directory() / 'room.yaml', directory() / 'parameters.yaml'
OWN.write_text('/**/driver:\n  ros__parameters:\n    frame_id: gripper_lidar\n')
# It is to be read once at least, however long the nodes take to start.
SILENT = silent_drone(directory(), start_s=3.0, packets=8)
# It hangs still, for the test does not know when the scene began.
STILL = silent_drone(directory(), start_s=0.2, packets=1000)


def check_sensor(observer):
    """A sensor that this test plugs."""
    wait_for_nodes(observer)
    with Sensor(COFFEE, PORTS / 'port') as sensor:
        wait_for_readings(observer, IDS)
        check_frames(observer, sensor, 'retrolidar_optical_frame')
        check_detections(observer, COFFEE, 'retrolidar_optical_frame')


def check_emulated(observer):
    """All markers are read, in the frame that the parameter file names, with its prefix."""
    wait_for_nodes(observer)
    wait_for_traffic(observer)
    wait_for_readings(observer, IDS)
    check_detections(observer, COFFEE, 'robot1/gripper_lidar', name='robot1/marker_{0.id}')


def check_three_sensors(observer):
    (drone,) = load_scene(str(STILL)).markers
    check_drone(observer, lambda _: np.array(drone.position_m))


def check_hall(observer):
    """Detections of two sensors in one process come on one topic, each in its sensor's frame."""

    def read():
        found = {name: set() for name in HALL}
        for message, _ in observer.markers:
            found[message.header.frame_id.removesuffix('_optical_frame')].add(message.id)
        return found

    with Sensor(COFFEE, PORTS / 'left'), Sensor(load_scene('drone'), PORTS / 'right'):
        assert observer.spin_until(lambda: read() == HALL, PATIENCE_S), read()


CASES = {
    'sensor': ('retrolidar', {'serial_port': str(PORTS / 'port')}, check_sensor),
    'emulated': (
        'retrolidar',
        {'emulate': 'coffee', 'params_file': str(OWN), 'frame_prefix': 'robot1/'},
        check_emulated,
    ),
    'coffee': (
        'coffee',
        {'emulate': 'coffee', 'max_stddev': '0.2'},
        lambda observer: check_coffee(observer, COFFEE, 'coffee', SENSOR_VIEW),
    ),
    'drone': (
        'drone',
        {'emulate': str(SILENT), 'params_file': str(impatient_parameters(directory()))},
        lambda observer: check_heartbeat(observer, load_scene(str(SILENT))),
    ),
    'three_sensors': (
        'drone',
        {'emulate': str(STILL), 'sensors': '3', 'single_process': 'true'},
        check_three_sensors,
    ),
    'two_sensors': (
        'two_sensors',
        {
            'marker_file': str(shared_file('config/markers.yaml')),
            **{f'{side}_emulate': 'coffee' for side in SIDES},
        },
        lambda observer: check_two_sensors(observer, COFFEE),
    ),
    # Driver and detector wait for a sensor: what the hand reads is said by the test.
    'landmarks': (
        'landmarks',
        {'save_file': str(SAVED), 'serial_port': str(PORTS / 'none')},
        lambda observer: check_landmarks(observer, SAVED),
    ),
    'hall': (
        'hall',
        {
            'serve': 'true',
            'server': SERVER,
            'ports': str([str(PORTS / name) for name in HALL]),
            'names': str(list(HALL)),
            'markers': '/launched_hall/markers',
        },
        check_hall,
    ),
}
"""A launch file, its arguments, and what is checked."""


GROUPS = {
    'plugged_sensor': ['sensor'],
    'one_sensor': ['drone', 'landmarks', 'emulated'],
    'objects': ['coffee', 'two_sensors'],
    'many_sensors': ['three_sensors', 'hall'],
}
"""What is launched at the same time; stamps are checked where nothing else starts."""
assert sorted(chain.from_iterable(GROUPS.values())) == sorted(CASES)
DOMAINS = {case: domain_of(index) for index, case in enumerate(CASES)}


@pytest.mark.launch_test
@launch_testing.parametrize('group', GROUPS)
def generate_test_description(group):
    actions = []
    for case in GROUPS[group]:
        name, arguments, _ = CASES[case]
        action = included(name, namespace=f'launched_{case}', **arguments)
        actions.append(in_domain(DOMAINS[case], action))
    return launched(*actions)


class TestLaunchFiles(unittest.TestCase):
    """What runs does what it is to do."""

    def test_them(self, group):
        observers = {}
        for case in GROUPS[group]:
            server = {'ROS_DISCOVERY_SERVER': SERVER} if case == 'hall' else {}
            observers[case] = observer_in(DOMAINS[case], f'/launched_{case}', **server)
            self.addCleanup(observers[case].close)
        check_at_once(self, {case: CASES[case][-1] for case in observers}, observers)


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """All processes end in order."""

    def test_exit_codes(self, proc_info):
        check_exit_codes(proc_info)
