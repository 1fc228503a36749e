# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Each launch file, with the assertions that test/nodes makes of plain processes."""

import os
import signal
import sys
import tempfile
import time
import unittest
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import chain
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest
import yaml

pytest.importorskip('launch_testing', reason='needs launch_testing, which has no wheel')

import launch_testing.actions
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from launch import LaunchDescription
from launch.actions import GroupAction, IncludeLaunchDescription, SetEnvironmentVariable
from launch.substitutions import PathJoinSubstitution
from launch_ros.actions import PushRosNamespace
from launch_ros.substitutions import FindPackageShare
from std_msgs.msg import Bool, String

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from harness import (
    MAX_MAHALANOBIS,
    PATIENCE_S,
    Sensor,
    check_detections,
    check_frames,
    silent_drone,
    wait_for_nodes,
    wait_for_readings,
    wait_for_traffic,
)
from harness_observer import COFFEE_IDS, RELIABLE, Observer, processes, values_of
from harness_tasks import SENSOR_VIEW, check_coffee, deviation_m, squared

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_ns, vector_of
from retrolidar_ros.nodes.emulated_arm import IN_BASE
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.settings.files import load_yaml, shared_file

COFFEE = load_scene('coffee')
SERVER = '127.0.0.1:11899'
SIDES = ('left', 'right')
HALL = {'left': COFFEE_IDS, 'right': {2127}}
ARM = load_scene('arm')
ROBOTS = ('robot1', 'robot2')  # in one domain
WANTED_M = 0.01


def directory():
    return Path(tempfile.mkdtemp(prefix='retrolidar_'))


PORTS, SAVED, OWN = directory(), directory() / 'room.yaml', directory() / 'parameters.yaml'
IMPATIENT = directory() / 'impatient.yaml'
QUALITIES = directory() / 'qualities.yaml'
QUALITIES.write_text(
    '/**:\n  ros__parameters:\n'
    '    qos_overrides./launched/robot1/points.publisher.reliability: best_effort\n'
)
OWN.write_text('/**/driver:\n  ros__parameters:\n    frame_id: gripper_lidar\n')
OVERDUE_AFTER_S = 2.0
LATENESS_S = 3.0  # of the node, which looks at the time ten times a second, on a busy machine
SHIPPED = load_yaml(shared_file('config/retrolidar.yaml'))
SHIPPED['/**/heartbeat']['ros__parameters']['overdue_after'] = OVERDUE_AFTER_S
IMPATIENT.write_text(yaml.safe_dump(SHIPPED))
# It is to be read once at least, however long the nodes take to start.
SILENT = silent_drone(directory(), start_s=3.0, packets=8)
# It hangs still, for the test does not know when the scene began.
STILL = silent_drone(directory(), start_s=0.2, packets=1000)


def check_sensor(observer):
    """A sensor that this test plugs."""
    wait_for_nodes(observer)
    with Sensor(COFFEE, PORTS / 'port') as sensor:
        wait_for_readings(observer, COFFEE_IDS)
        check_frames(observer, sensor, 'retrolidar_optical_frame')
        check_detections(observer, COFFEE, 'retrolidar_optical_frame')


def check_emulated(observer):
    """All markers are read, in the frame that the parameter file names, with its prefix."""
    wait_for_nodes(observer)
    wait_for_traffic(observer)
    wait_for_readings(observer, COFFEE_IDS)
    check_detections(observer, COFFEE, 'robot1/gripper_lidar', name='robot1/marker_{0.id}')


def check_heartbeat(observer):
    """A drone is alive from its first reading on, and overdue some time after its last."""
    name, (marker,) = 'heartbeat: markers', load_scene(str(SILENT)).markers
    alive = observer.collect(Bool, 'heartbeat/alive')
    observer.wait(lambda: bool(alive) and alive[-1].data, 'life')
    alive.clear()
    values = values_of(observer.wait_for_status(name, DiagnosticStatus.OK, 'all markers are read'))
    assert int(values['drone: readings']) >= 1
    assert float(values['drone: silence [s]']) <= OVERDUE_AFTER_S
    observer.wait(lambda: bool(alive), 'silence to be noticed')
    late_s = time.time() - 1e-9 * observer.markers[-1][1] - OVERDUE_AFTER_S
    assert abs(late_s) < LATENESS_S
    assert [one.data for one in alive] == [False]  # and it was alive between its readings
    read = [(one.id, one.child_frame_id) for one, _ in observer.markers]
    assert {*read} == {(marker.id, 'drone')}
    values = values_of(observer.wait_for_status(name, DiagnosticStatus.WARN, 'overdue: drone'))
    # A marker that has just appeared may be read before its packet has come, and then the whole.
    assert len(read) <= int(values['drone: readings']) <= marker.packets + 1
    silence_s, longest_s = (float(values[f'drone: {one}silence [s]']) for one in ('', 'longest '))
    assert OVERDUE_AFTER_S <= silence_s <= longest_s


def check_two_sensors(observer):
    """What both sensors see comes on one topic, and each marker has one TF frame below each."""
    frames = {side: observer.collect(FrameMsg, f'{side}/frames', RELIABLE) for side in SIDES}
    optical = {side: f'{side}_optical_frame' for side in SIDES}
    names = {f'{side}_{marker.name}': optical[side] for side in SIDES for marker in COFFEE.markers}
    observer.wait(lambda: all(frames.values()), 'both sensors')
    for side in SIDES:
        check_detections(observer, COFFEE, optical[side], frames[side], f'{side}_{{0.name}}')
        assert {one.header.frame_id for one in frames[side]} == {optical[side]}
    left, right = ({to_ns(one.header.stamp) for one in frames[side]} for side in SIDES)
    assert not left & right
    sent = {(one.child_frame_id, one.header.frame_id) for one in observer.transforms}
    assert {one for one in sent if one[1] in optical.values()} == {*names.items()}


def check_three_sensors(observer):
    """Three sensors on the ground tell where a drone is, across their lines of sight, too."""
    (drone,) = load_scene(str(STILL)).markers
    poses = observer.collect(PoseWithCovarianceStamped, 'landmarks/objects/drone', RELIABLE)
    observer.wait(lambda: len(poses) >= 12, 'twelve poses')
    frames = {message.header.frame_id for message, _ in observer.markers}
    assert frames == {f'sensor{index}_optical_frame' for index in range(3)}
    for pose in poses[-6:]:
        assert pose.header.frame_id == 'ground'
        assert squared(pose, np.array(drone.position_m)) < MAX_MAHALANOBIS
        assert deviation_m(pose) < 0.04
    status = observer.wait_for_status('landmarks: landmarks', DiagnosticStatus.OK, '1 placed')
    assert float(values_of(status)['drone: baseline [m]']) == pytest.approx(0.4, abs=1e-3)


def check_hall(observer):
    """Detections of two sensors in one process come on one topic, each in its sensor's frame."""

    def read():
        found = {name: set() for name in HALL}
        for message, _ in observer.markers:
            found[message.header.frame_id.removesuffix('_optical_frame')].add(message.id)
        return found

    with Sensor(COFFEE, PORTS / 'left'), Sensor(load_scene('drone'), PORTS / 'right'):
        assert observer.spin_until(lambda: read() == HALL, PATIENCE_S), read()


ROBOT = {
    'emulate': 'coffee',
    'params_file': str(QUALITIES),
    'respawn_delay': '0.5',
    'log_level': 'warn',
}


def check_robot(observer, nodes, reliability):
    """Each is read by itself, qualities of service are its own, and what is killed comes again."""
    wait_for_traffic(observer)
    wait_for_readings(observer, COFFEE_IDS)
    check_detections(observer, COFFEE, 'retrolidar_optical_frame')
    (found,) = observer.node.get_publishers_info_by_topic(f'{observer.namespace}/points')
    assert found.qos_profile.reliability.name == reliability
    for node in nodes:
        own = (f'/retrolidar_ros/{node}\0', f'__ns:={observer.namespace}\0')
        (pid,) = (pid for pid, line in processes() if all(part in line for part in own))
        os.kill(pid, signal.SIGKILL)
        killed_ns = time.time_ns()

        def read_since(since_ns=killed_ns):
            # What was read before may still come.
            return {one.id for one, _ in observer.markers if to_ns(one.start) > since_ns}

        observer.wait(lambda read=read_since: read() >= COFFEE_IDS, node)


def check_arm(observer, node):
    """All objects get to a centimetre within a minute, and are where they are."""
    truth = {one.name: IN_BASE @ np.array(one.position_m) for one in ARM.markers}
    poses = {
        name: observer.collect(PoseWithCovarianceStamped, f'{node}/objects/{name}')
        for name in truth
    }

    def are_known():
        spread = [deviation_m(one[-1]) for one in poses.values() if one]
        return len(spread) == len(truth) and max(spread) <= WANTED_M

    observer.wait(are_known, 'objects that are known to a centimetre')
    for name, came in poses.items():
        assert came[-1].header.frame_id == 'base_link'
        assert squared(came[-1], truth[name]) < MAX_MAHALANOBIS, name


def check_landmarks(observer):
    """Driver and detector wait for a sensor, so nothing is placed."""
    wait_for_nodes(observer)
    success, message = observer.services.trigger('landmarks/save')
    assert not success
    assert 'nothing is placed' in message


def check_arm_of_landmarks(observer):
    check_arm(observer, 'landmarks')
    assert observer.services.trigger('landmarks/save')[0]
    assert {*load_yaml(SAVED)['landmarks']} == {one.name for one in ARM.markers}


def check_arm_of_coffee(observer):
    ready = observer.collect(Bool, 'coffee/ready')
    views = observer.collect(PoseStamped, 'coffee/next_view')
    missing = observer.collect(String, 'coffee/missing')
    check_arm(observer, 'coffee')
    observer.wait(lambda: ready[-1].data and not missing[-1].data, 'coffee that is ready')
    assert views
    # The reach is around the place of the first reading; the arm does not stand there.
    first_ns = to_ns(views[0].header.stamp)
    places = np.array(
        [
            vector_of(one.transform.translation)
            for one in observer.transforms
            if one.child_frame_id == 'retrolidar_optical_frame'
            and to_ns(one.header.stamp) <= first_ns
        ]
    )
    for view in views:
        assert view.header.frame_id == 'base_link'
        apart_m = np.linalg.norm(vector_of(view.pose.position) - places, axis=1)
        assert apart_m.min() < 0.5 + 0.02
    stamps = np.array([one.header.stamp.sec for one in views])
    assert len(views) < 12, stamps  # not with every reading


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
    'drone': ('drone', {'emulate': str(SILENT), 'params_file': str(IMPATIENT)}, check_heartbeat),
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
        check_two_sensors,
    ),
    'landmarks': (
        'landmarks',
        {'save_file': str(SAVED), 'serial_port': str(PORTS / 'none')},
        check_landmarks,
    ),
    'hall': (
        'hall',
        {
            'serve': 'true',
            'server': SERVER,
            'ports': str([str(PORTS / name) for name in HALL]),
            'names': str(list(HALL)),
            'markers': '/launched/hall/markers',
        },
        check_hall,
    ),
    'robot1': (
        'retrolidar',
        ROBOT,
        partial(check_robot, nodes=('detector', 'driver'), reliability='BEST_EFFORT'),
    ),
    'robot2': (
        'retrolidar',
        {**ROBOT, 'single_process': 'true'},
        partial(check_robot, nodes=('reader',), reliability='RELIABLE'),
    ),
    'arm': ('landmarks', {'emulate': 'arm', 'save_file': str(SAVED)}, check_arm_of_landmarks),
    'arm_of_coffee': ('coffee', {'emulate': 'arm'}, check_arm_of_coffee),
}
"""A launch file, its arguments, and what is checked."""


GROUPS = {
    'plugged_sensor': ['sensor'],
    'one_sensor': ['drone', 'landmarks', 'emulated'],
    'objects': ['coffee', 'two_sensors'],
    'robots': [*ROBOTS],
    'arms': ['arm', 'arm_of_coffee'],  # which reach their goals by themselves
    # Last: a process that has used a discovery server does not discover others without one.
    'many_sensors': ['three_sensors', 'hall'],
}
"""What is launched at the same time; stamps are checked where nothing else starts."""
assert sorted(chain.from_iterable(GROUPS.values())) == sorted(CASES)
# Above the ports that Linux gives to others; launch_test picks one from those below them.
FIRST = 10 * int(os.environ.get('ROS_DOMAIN_ID', '0'))
DOMAINS = {case: str(215 + (FIRST + index) % 18) for index, case in enumerate(CASES)}
DOMAINS |= dict.fromkeys(ROBOTS, DOMAINS[ROBOTS[0]])


@pytest.mark.launch_test
@launch_testing.parametrize('group', GROUPS)
def generate_test_description(group):
    actions = []
    for case in GROUPS[group]:
        name, arguments, _ = CASES[case]
        share = FindPackageShare('retrolidar_ros')
        file = PathJoinSubstitution([share, 'launch', f'{name}.launch.py'])
        given = {'namespace': case, **arguments}.items()
        action = IncludeLaunchDescription(file, launch_arguments=given)
        domain = SetEnvironmentVariable('ROS_DOMAIN_ID', DOMAINS[case])
        actions.append(GroupAction([domain, PushRosNamespace('launched'), action]))
    return LaunchDescription([*actions, launch_testing.actions.ReadyToTest()])


class TestLaunchFiles(unittest.TestCase):
    """What runs does what it is to do."""

    def test_them(self, group):
        observers = {}
        for case in GROUPS[group]:
            server = {'ROS_DISCOVERY_SERVER': SERVER} if case == 'hall' else {}
            with patch.dict(os.environ, {'ROS_DOMAIN_ID': DOMAINS[case], **server}):
                observers[case] = Observer(f'/launched/{case}')
            self.addCleanup(observers[case].close)
        with ThreadPoolExecutor(len(observers)) as pool:
            results = {case: pool.submit(CASES[case][-1], one) for case, one in observers.items()}
        for case, result in results.items():
            with self.subTest(case):
                result.result()


@launch_testing.post_shutdown_test()
class TestEnd(unittest.TestCase):
    """All processes end in order, but for those that were killed."""

    def test_exit_codes(self, proc_info, group):
        killed = {-signal.SIGKILL} if group == 'robots' else set()
        for info in proc_info:
            # These commands may say that they were interrupted.
            is_command = info.process_name.rpartition('-')[0] in ('emulator', 'server')
            allowed = {0, *killed, *([130] if is_command else [])}
            assert info.returncode in allowed, (info.process_name, info.returncode)
