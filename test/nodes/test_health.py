# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What running nodes say of themselves and of each other while something is wrong.

Driver and detector in a process each, and both in one: the same sensor is put to both.
"""

import os
import signal
import subprocess
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import Sensor, check_cable_pull, check_detections, wait_for_readings
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import Header
from tf2_msgs.msg import TFMessage

from retrolidar_ros.cli.demo import executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_frame_msg, to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.settings.resources import shared_file

FRAME_ID = 'retrolidar_optical_frame'
IDS = {2073, 2096, 2107}
PATIENCE_S = 20.0


class System:
    """Nodes of a namespace, and what they say."""

    def __init__(self, namespace: str, directory: Path) -> None:
        self.namespace = namespace
        self.port = directory / f'port{namespace.replace("/", "_")}'
        self.listener = Listener(namespace)
        self.statuses: defaultdict[str, list[DiagnosticStatus]] = defaultdict(list)
        self.sensor: Sensor
        node = self.listener.node
        node.create_subscription(DiagnosticArray, '/diagnostics', self._hear, 100)
        self.processes = ProcessGroup(directory)
        self._clients: dict[str, Any] = {}

    def _hear(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.statuses[status.name.removeprefix(f'{self.namespace}/')].append(status)

    def start(self, node: str, *parameters: str) -> None:
        command = [executable(node), '--ros-args', '-r', f'__ns:={self.namespace}']
        for parameter in (f'serial_port:={self.port}', *parameters):
            command += ['-p', parameter]
        self.processes.start(node, command)

    def wait(self, done: Callable[[], bool], what: str, timeout_s: float = PATIENCE_S) -> None:
        assert self.listener.spin_until(done, timeout_s), f'waited in vain for {what}'

    def wait_for_status(
        self, name: str, level: bytes, text: str, timeout_s: float = PATIENCE_S
    ) -> DiagnosticStatus:
        """Return the next status of a level that has a text within."""
        heard = len(self.statuses[name])
        found: list[DiagnosticStatus] = []

        def is_there() -> bool:
            found.extend(
                one
                for one in self.statuses[name][heard:]
                if one.level == level and text in one.message
            )
            return bool(found)

        self.wait(is_there, f'{text} of {name}, not {self.statuses[name][-3:]}', timeout_s)
        return found[0]

    def call(self, kind: Any, name: str, request: Any) -> Any:
        client = self._clients.get(name) or self.listener.node.create_client(
            kind, f'{self.namespace}/{name}'
        )
        self._clients[name] = client
        self.wait(client.service_is_ready, name)
        future = client.call_async(request)
        self.wait(future.done, f'an answer of {name}')
        return future.result()

    def change(self, transition: int) -> bool:
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(self.call(ChangeState, 'driver/change_state', request).success)

    def state(self) -> str:
        answer = self.call(GetState, 'driver/get_state', GetState.Request())
        return str(answer.current_state.label)


def value(status: DiagnosticStatus, key: str) -> int:
    return int({one.key: one.value for one in status.values}[key])


@pytest.fixture(scope='module', params=['two', 'one'])
def system(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[System]:
    """Start the nodes in two processes, or in one, and give them a sensor."""
    system = System(f'/{request.param}_process', tmp_path_factory.mktemp('health'))
    with system.processes, Sensor(load_scene('coffee'), system.port) as sensor:
        if request.param == 'one':
            system.start('reader')
        else:
            system.start('driver', 'autostart:=true')
            system.start('detector')
        system.sensor = sensor
        system.wait(lambda: bool(system.listener.markers), 'a reading')
        yield system
        system.processes.check()
    system.listener.close()


@pytest.fixture
def two(system: System) -> System:
    if system.namespace != '/two_process':
        pytest.skip('is about processes of their own')
    return system


def test_markers_are_read_and_placed(system: System) -> None:
    system.listener.markers.clear()
    wait_for_readings(system.listener, IDS)
    check_detections(system.listener, load_scene('coffee'), FRAME_ID)
    system.wait_for_status('detector: markers', DiagnosticStatus.OK, 'candidates accepted')
    system.wait_for_status('driver: frames', DiagnosticStatus.OK, 'frames a second')


def test_transforms_go_out_before_what_they_belong_to(system: System) -> None:
    """By the times at which they were sent: on the way, one topic may still overtake another."""
    node = system.listener.node
    sent: dict[str, dict[int, int]] = {'transforms': {}, 'markers': {}}

    def take_transforms(message: TFMessage, info: dict[str, int]) -> None:
        for one in message.transforms:
            sent['transforms'][to_ns(one.header.stamp)] = info['source_timestamp']

    def take_marker(message: MarkerDetection, info: dict[str, int]) -> None:
        sent['markers'][to_ns(message.header.stamp)] = info['source_timestamp']

    topic = f'{system.namespace}/markers'
    both = [
        node.create_subscription(TFMessage, '/tf', cast(Any, take_transforms), 100),
        node.create_subscription(MarkerDetection, topic, cast(Any, take_marker), 100),
    ]
    system.wait(lambda: len(sent['transforms'].keys() & sent['markers'].keys()) > 5, 'readings')
    for one in both:
        node.destroy_subscription(one)
    for stamp_ns in sent['transforms'].keys() & sent['markers'].keys():
        assert sent['transforms'][stamp_ns] < sent['markers'][stamp_ns]


def test_a_heartbeat_tells_up_to_when_all_was_judged(system: System) -> None:
    beats: list[Header] = []
    subscription = system.listener.node.create_subscription(
        Header, f'{system.namespace}/detector/heartbeat', beats.append, 10
    )
    system.wait(lambda: len(beats) > 5, 'heartbeats')
    stamps = [to_ns(beat.stamp) for beat in beats]
    assert stamps == sorted(set(stamps))
    assert {beat.frame_id for beat in beats} == {FRAME_ID}
    assert set(stamps) <= {to_ns(message.header.stamp) for message, _ in system.listener.frames}
    sensor = system.sensor
    sensor.pull()
    system.wait_for_status('detector: markers', DiagnosticStatus.STALE, 'no frame has come')
    silent = len(beats)
    system.wait_for_status('detector: markers', DiagnosticStatus.STALE, 'no frame has come')
    assert len(beats) == silent
    sensor.plug()
    system.wait(lambda: len(beats) > silent, 'a heartbeat')
    system.listener.node.destroy_subscription(subscription)


def test_a_cable_may_be_pulled(system: System) -> None:
    check_cable_pull(system.listener, system.sensor)


def test_the_life_cycle_goes_on_while_the_cable_is_out(system: System) -> None:
    sensor = system.sensor
    assert system.state() == 'active'
    assert not system.change(Transition.TRANSITION_CONFIGURE)  # and the node lives on
    sensor.pull()
    assert system.change(Transition.TRANSITION_DEACTIVATE)
    assert system.change(Transition.TRANSITION_CLEANUP)
    assert system.state() == 'unconfigured'
    system.wait_for_status('driver: frames', DiagnosticStatus.WARN, 'not configured')
    assert system.change(Transition.TRANSITION_CONFIGURE)
    system.wait_for_status('driver: frames', DiagnosticStatus.ERROR, 'does not exist')
    sensor.plug()
    system.wait_for_status('driver: frames', DiagnosticStatus.WARN, 'not active')
    before = len(system.listener.frames)
    system.wait_for_status('driver: frames', DiagnosticStatus.WARN, 'not active')
    assert len(system.listener.frames) == before
    assert system.change(Transition.TRANSITION_ACTIVATE)
    system.wait(lambda: len(system.listener.frames) > before, 'frames')
    system.wait_for_status('detector: markers', DiagnosticStatus.OK, 'accepted')


def test_depth_is_the_image_of_a_pinhole(system: System) -> None:
    images: dict[int, Image] = {}
    cameras: dict[int, CameraInfo] = {}

    def keep(kept: Any) -> Callable[[Any], None]:
        return lambda message: kept.update({to_ns(message.header.stamp): message})

    node, space = system.listener.node, f'{system.namespace}/depth'
    both = [
        node.create_subscription(Image, f'{space}/image_raw', keep(images), 10),
        node.create_subscription(CameraInfo, f'{space}/camera_info', keep(cameras), 10),
    ]
    frames = system.listener.frames
    system.wait(lambda: len(images.keys() & cameras.keys()) > 3, 'images')
    for one in both:
        node.destroy_subscription(one)
    stamp_ns = sorted(images.keys() & cameras.keys())[0]
    system.wait(lambda: any(to_ns(m.header.stamp) == stamp_ns for m, _ in frames), 'the frame')
    (frame,) = (m for m, _ in frames if to_ns(m.header.stamp) == stamp_ns)
    depth = np.frombuffer(images[stamp_ns].data, '<f4')
    sure = np.isfinite(depth)
    assert sure.sum() > 8
    assert (depth[sure] == np.asarray(frame.distance)[sure]).all()
    camera = cameras[stamp_ns]
    matrix = np.array(camera.k).reshape(3, 3)
    row, column = np.divmod(np.arange(16), camera.width)
    rays = np.linalg.solve(matrix, np.stack([column, row, np.ones(16)]))
    assert pytest.approx(ZoneGrid(4, 4).tangents) == rays[:2].T


def test_a_detector_that_is_stopped_is_told_of_and_counts_what_it_lost(two: System) -> None:
    pid = two.processes.pid('detector')
    lost = value(two.statuses['detector: markers'][-1], 'lost frames')
    os.kill(pid, signal.SIGSTOP)
    try:
        two.wait_for_status('detector: markers', DiagnosticStatus.STALE, 'has been judged', 2.5)
        two.listener.spin_until(lambda: False, 8.0)
    finally:
        os.kill(pid, signal.SIGCONT)
    status = two.wait_for_status('detector: markers', DiagnosticStatus.WARN, 'were lost', 2.0)
    assert value(status, 'lost frames') - lost > 250
    two.wait_for_status('detector: markers', DiagnosticStatus.OK, 'accepted')


def test_a_detector_that_is_killed_is_stale(two: System) -> None:
    os.kill(two.processes.pid('detector'), signal.SIGKILL)
    two.wait_for_status('detector: markers', DiagnosticStatus.STALE, 'has ended, or hangs', 3.0)
    two.processes.stop('detector')
    two.start('detector')
    two.wait_for_status('detector: markers', DiagnosticStatus.OK, 'accepted')


def test_two_senders_of_one_frame_id_are_an_error_that_names_them(two: System) -> None:
    publisher = two.listener.node.create_publisher(FrameMsg, 'frames', 10)
    frames = iter(Simulation(load_scene('coffee')).run(60.0))

    def send() -> None:
        frame = replace(next(frames), stamp_ns=two.listener.node.get_clock().now().nanoseconds)
        publisher.publish(to_frame_msg(frame, FRAME_ID))

    timer = two.listener.node.create_timer(0.021, send)
    try:
        status = two.wait_for_status('detector: markers', DiagnosticStatus.ERROR, 'come mixed by')
        assert '/two_process/driver, /two_process/listener' in status.message
    finally:
        two.listener.node.destroy_timer(timer)
        two.listener.node.destroy_publisher(publisher)
    two.wait_for_status('detector: markers', DiagnosticStatus.OK, 'accepted')


def test_what_blinks_by_other_bits_is_told_for_as_long_as_it_does(two: System) -> None:
    other = f'{two.namespace}_slow'
    command = [executable('detector'), '--ros-args', '-r', f'__ns:={other}']
    command += ['-r', f'frames:={two.namespace}/frames', '-p', 'bit_period:=0.084']
    two.processes.start('slow', command)
    name = f'{other}/detector: markers'
    for _ in range(2):
        status = two.wait_for_status(name, DiagnosticStatus.WARN, 'and is not read: its bits last')
        assert 'its bits last 42.' in status.message
    two.processes.stop('slow')


def test_qualities_of_service_may_be_overridden(tmp_path: Path) -> None:
    listener = Listener('/qos')
    topic = 'qos_overrides./qos/frames'
    command = [executable('driver'), '--ros-args', '-r', '__ns:=/qos']
    command += ['-p', f'{topic}.publisher.reliability:=best_effort']
    command += ['-p', f'{topic}.publisher.depht:=3', '-p', 'qos_overrides./nowhere.depth:=3']
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:

        def qualities() -> set[str]:
            found = listener.node.get_publishers_info_by_topic('/qos/frames')
            return {one.qos_profile.reliability.name for one in found}

        assert listener.spin_until(lambda: bool(qualities()), PATIENCE_S)
        assert qualities() == {'BEST_EFFORT'}
    finally:
        process.terminate()
        _, errors = process.communicate(timeout=10)
        listener.close()
    assert f'{topic}.publisher.depht is unknown; did you mean {topic}.publisher.depth?' in errors
    assert 'qos_overrides./nowhere.depth is unknown' in errors


@pytest.mark.parametrize(
    ('text', 'warned'),
    [
        ('/**:\n  ros__parameters: {use_sim_time: false, robot_name: r2, method: paper}', []),
        ('/**/driver:\n  ros__parameters: {robot_name: r2}', ['robot_name']),
        ('/**:\n  ros__parameters: {serial_prt: x}', ['serial_prt is unknown; did you mean']),
    ],
)
def test_parameters_for_all_nodes_draw_no_false_warnings(
    text: str, warned: list[str], tmp_path: Path
) -> None:
    listener = Listener('/all')
    (tmp_path / 'all.yaml').write_text(text)
    command = [executable('driver'), '--ros-args', '-r', '__ns:=/all']
    command += ['--params-file', str(tmp_path / 'all.yaml')]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert listener.spin_until(lambda: listener.node.count_publishers('frames') > 0, PATIENCE_S)
    process.terminate()
    _, errors = process.communicate(timeout=10)
    listener.close()
    warnings = [line for line in errors.splitlines() if 'is unknown' in line]
    assert len(warnings) == len(warned), warnings
    assert all(text in line for text, line in zip(warned, warnings, strict=True))


def test_poses_of_known_markers_come_by_their_names(tmp_path: Path) -> None:
    listener = Listener('/poses')
    poses: list[PoseStamped] = []
    listener.node.create_subscription(PoseStamped, '/poses/poses/mug', poses.append, 10)
    markers = shared_file('config/markers.yaml')
    with ProcessGroup(tmp_path) as processes, Sensor(load_scene('coffee'), tmp_path / 'port'):
        command = [executable('reader'), '--ros-args', '-r', '__ns:=/poses']
        command += ['-p', f'serial_port:={tmp_path / "port"}', '-p', f'marker_file:={markers}']
        processes.start('reader', command)

        def is_heard() -> bool:
            heard = [m.pose.pose for m, _ in listener.markers if m.child_frame_id == 'mug']
            return bool(poses) and poses[-1].pose in heard

        assert listener.spin_until(is_heard, PATIENCE_S)
    listener.close()


def test_many_sensors_are_read_in_one_process(tmp_path: Path) -> None:
    names = ['left', 'right']
    listeners = {name: Listener(f'/many/{name}') for name in names}
    ports = {name: tmp_path / name for name in names}
    with (
        ProcessGroup(tmp_path) as processes,
        Sensor(load_scene('coffee'), ports['left']),
        Sensor(load_scene('drone'), ports['right']),
    ):
        command = [executable('reader'), '--ros-args', '-r', '__ns:=/many']
        command += ['-p', f'ports:={[str(path) for path in ports.values()]}']
        processes.start('reader', [*command, '-p', f'names:={names}'])
        for name, expected in (('left', IDS), ('right', {2127})):
            wait_for_readings(listeners[name], expected)
            (message, _), *_ = listeners[name].markers
            assert message.header.frame_id == f'{name}_optical_frame'
            assert message.child_frame_id == f'{name}_marker_{message.id}'
        assert processes.stop('reader') == 0
    for listener in listeners.values():
        listener.close()


def test_a_list_of_sensors_that_cannot_be_is_one_clear_line() -> None:
    for parameters, reason in (
        (['ports:=[/a, /b]', 'names:=[x]'], 'names: 1 of them for 2 ports'),
        (['ports:=[/a, /a]'], 'ports: one stands there twice'),
        (['frame_id:=/odom'], "frame_id: '/odom' begins with a slash, which tf2 refuses"),
    ):
        command = [executable('reader'), '--ros-args']
        for parameter in parameters:
            command += ['-p', parameter]
        result = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
        assert result.returncode == 2
        assert reason in result.stderr
        assert 'Traceback' not in result.stderr
