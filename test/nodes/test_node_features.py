# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What driver and detector offer beside frames and markers, and what they say when they cannot."""

import os
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import serial

pytest.importorskip('rclpy', reason='needs ROS 2')
pytest.importorskip('retrolidar_ros.msg', reason='needs the messages: colcon build')

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from harness import Sensor
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from sensor_msgs.msg import Image, PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from retrolidar_ros.cli.demo import NAMESPACE, executable
from retrolidar_ros.cli.processes import ProcessGroup
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes import detection_topics, frame_topics
from retrolidar_ros.nodes.conversion import to_frame_msg, to_ns
from retrolidar_ros.nodes.detector import DetectorNode
from retrolidar_ros.nodes.driver import DriverNode
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import Scene
from retrolidar_ros.scene.emulator import PortLink
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.sensor.frame import Floats, Frame, ZoneGrid
from retrolidar_ros.sensor.rotation import matrix_of
from retrolidar_ros.sensor.wire import encode_frame

PATIENCE_S = 20.0
FRAME_ID = 'retrolidar_optical_frame'
DARK_ZONES = {0, 15}
MARKER_FILE = 'markers: {2073: {frame: beans}, 2096: {frame: machine}, 2127: {frame: drone}}'
NAMES = {2073: 'beans', 2096: 'machine', 2107: 'marker_2107'}
Diagnostics = defaultdict[str, list[DiagnosticStatus]]


def collect_diagnostics(listener: Listener) -> Diagnostics:
    """Keep what all nodes say of themselves, by the names they say it under."""
    heard: Diagnostics = defaultdict(list)

    def take(message: DiagnosticArray) -> None:
        for status in message.status:
            heard[status.name].append(status)

    listener.node.create_subscription(DiagnosticArray, '/diagnostics', take, 100)
    return heard


def values_of(status: DiagnosticStatus) -> dict[str, str]:
    return {value.key: value.value for value in status.values}


def node_command(node: str, namespace: str, **parameters: object) -> list[str]:
    command = [executable(node), '--ros-args', '-r', f'__ns:={namespace}']
    for name, value in parameters.items():
        command += ['-p', f'{name}:={value}']
    return command


def scene_with_dark_zones() -> Scene:
    """Return a scene in some of whose zones there is nothing."""
    scene = load_scene('coffee')
    wall = scene.surfaces[-1]
    assert wall.zones is not None
    seen = tuple(zone for zone in wall.zones if zone not in DARK_ZONES)
    return replace(scene, surfaces=(*scene.surfaces[:-1], replace(wall, zones=seen)))


def endless(scene: Scene) -> Iterator[Frame]:
    simulation = Simulation(scene)
    while True:
        yield from simulation.advance(100)


@contextmanager
def subscribed(listener: Listener, kind: Any, topic: str) -> Iterator[list[Any]]:
    """Subscribe for as long as the block lasts; what comes is in the list."""
    came: list[Any] = []
    subscription = listener.node.create_subscription(kind, topic, came.append, 100)
    try:
        yield came
    finally:
        listener.node.destroy_subscription(subscription)


@dataclass
class Chain:
    """A sensor, its driver, and three detectors that hear it."""

    listener: Listener
    sensor: Sensor
    diagnostics: Diagnostics
    readings: dict[str, list[MarkerDetection]]
    """By namespace."""

    def wait(self, done: Callable[[], bool], what: str) -> None:
        assert self.listener.spin_until(done, PATIENCE_S), f'waited in vain for {what}'

    def wait_for_readings(self, namespace: str, count: int, *ids: int) -> None:
        """Wait until each of these IDs was read so often."""
        found = self.readings[namespace]
        self.wait(
            lambda: all([one.id for one in found].count(identity) >= count for identity in ids),
            f'{ids} in {namespace}',
        )

    def next_diagnostics(self, name: str) -> DiagnosticStatus:
        seen = len(self.diagnostics[name])
        self.wait(lambda: len(self.diagnostics[name]) > seen, name)
        return self.diagnostics[name][-1]

    def senders_of_tf(self) -> set[str]:
        return {
            f'{end.node_namespace}/{end.node_name}'
            for end in self.listener.node.get_publishers_info_by_topic('/tf')
        }


@pytest.fixture(scope='module')
def chain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chain]:
    directory = tmp_path_factory.mktemp('features')
    known, port = directory / 'markers.yaml', directory / 'port'
    known.write_text(MARKER_FILE)
    frames = ['-r', f'frames:={NAMESPACE}/frames']
    listener = Listener(NAMESPACE)
    readings: dict[str, list[MarkerDetection]] = {}
    for namespace in (NAMESPACE, '/left', '/mute'):
        readings[namespace] = []
        listener.node.create_subscription(
            MarkerDetection, f'{namespace}/markers', readings[namespace].append, 100
        )
    with ProcessGroup(directory) as processes, Sensor(scene_with_dark_zones(), port) as sensor:
        processes.start('driver', node_command('driver', NAMESPACE, serial_port=port))
        processes.start('detector', node_command('detector', NAMESPACE, marker_file=known))
        left = node_command(
            'detector',
            '/left',
            method='paper',
            marker_file=known,
            only_registered='true',
            child_frame='left_{name}',
        )
        processes.start('left', left + frames)
        mute = node_command(
            'detector',
            '/mute',
            registered_ids=[2096, 2107],
            child_frame='mute/{name}',
            publish_tf='false',
        )
        processes.start('mute', mute + frames)
        chain = Chain(listener, sensor, collect_diagnostics(listener), readings)
        chain.wait_for_readings(NAMESPACE, 1, *NAMES)
        yield chain
        processes.check()
    listener.close()


def frames_by_stamp(listener: Listener) -> dict[int, FrameMsg]:
    return {to_ns(message.header.stamp): message for message, _ in listener.frames}


def test_points_are_what_each_zone_saw(chain: Chain) -> None:
    with subscribed(chain.listener, PointCloud2, 'points') as clouds:
        chain.wait(lambda: len(clouds) >= 20, 'points')
    frames = frames_by_stamp(chain.listener)
    for cloud in clouds[:15]:
        frame = frames[to_ns(cloud.header.stamp)]
        assert cloud.header == frame.header
        assert (cloud.height, cloud.width) == (4, 4)
        assert (cloud.point_step, cloud.row_step, cloud.is_bigendian) == (20, 80, False)
        assert [field.name for field in cloud.fields] == ['x', 'y', 'z', 'signal', 'ambient']
        assert [field.offset for field in cloud.fields] == [0, 4, 8, 12, 16]
        assert {field.datatype for field in cloud.fields} == {PointField.FLOAT32}
        points = np.frombuffer(bytes(cloud.data), dtype='<f4').reshape(16, 5)
        missing = np.isnan(np.array(frame.distance))
        assert set(np.flatnonzero(missing)) == DARK_ZONES
        assert not cloud.is_dense
        assert np.isnan(points[missing, :3]).all()
        depth = np.array(frame.distance)[:, None]
        expected = np.hstack([depth * ZoneGrid().tangents, depth])
        np.testing.assert_allclose(points[~missing, :3], expected[~missing], rtol=1e-6)
        np.testing.assert_array_equal(points[:, 3], frame.signal)
        np.testing.assert_array_equal(points[:, 4], frame.ambient)


def test_the_signal_image_is_the_signal(chain: Chain) -> None:
    with subscribed(chain.listener, Image, 'signal_image') as images:
        chain.wait(lambda: len(images) >= 20, 'images')
    frames = frames_by_stamp(chain.listener)
    for image in images[:15]:
        frame = frames[to_ns(image.header.stamp)]
        assert image.header == frame.header
        assert (image.height, image.width, image.encoding) == (4, 4, '32FC1')
        assert (image.step, image.is_bigendian) == (16, 0)
        signal = np.frombuffer(bytes(image.data), dtype='<f4')
        np.testing.assert_array_equal(signal, frame.signal)


def test_detections_are_drawn_with_their_uncertainty(chain: Chain) -> None:
    with subscribed(chain.listener, MarkerArray, 'marker_array') as arrays:
        chain.wait(lambda: sum(len(array.markers) for array in arrays) >= 6, 'shapes')
    shapes = [shape for array in arrays for shape in array.markers]
    found = {(one.id, to_ns(one.header.stamp)): one for one in chain.readings[NAMESPACE]}
    chain.wait(lambda: len(chain.readings[NAMESPACE]) >= len(shapes) // 2, 'detections')
    for ellipsoid, label in zip(shapes[::2], shapes[1::2], strict=True):
        detection = found[ellipsoid.id, to_ns(ellipsoid.header.stamp)]
        for shape, layer in ((ellipsoid, 'place'), (label, 'label')):
            assert shape.header == detection.header
            assert (shape.ns, shape.id) == (f'{FRAME_ID}/{layer}', detection.id)
            assert shape.action == Marker.ADD
            assert (shape.lifetime.sec, shape.lifetime.nanosec) == (4, 0)
            assert shape.color.a > 0
        assert (ellipsoid.type, label.type) == (Marker.SPHERE, Marker.TEXT_VIEW_FACING)
        assert label.text == f'{detection.child_frame_id}\n{detection.range:.3f} m'
        assert ellipsoid.pose.position == detection.pose.pose.position
        covariance = np.array(detection.pose.covariance).reshape(6, 6)[:3, :3]
        np.testing.assert_allclose(drawn_covariance(ellipsoid), covariance, atol=0.0025**2)


def drawn_covariance(ellipsoid: Marker) -> Floats:
    """Return the covariance whose two standard deviations are the half axes."""
    turn, scale = ellipsoid.pose.orientation, ellipsoid.scale
    axes = matrix_of(np.array([turn.x, turn.y, turn.z, turn.w]))
    covariance: Floats = axes * (np.array([scale.x, scale.y, scale.z]) / 4) ** 2 @ axes.T
    return covariance


def test_a_known_marker_goes_by_its_name(chain: Chain) -> None:
    chain.wait_for_readings(NAMESPACE, 1, *NAMES)
    for detection in chain.readings[NAMESPACE]:
        assert detection.child_frame_id == NAMES.get(detection.id, f'marker_{detection.id}')
    chain.wait(
        lambda: set(NAMES.values()) <= {one.child_frame_id for one in chain.listener.transforms},
        'transforms',
    )


def test_names_may_be_prefixed_for_a_second_sensor(chain: Chain) -> None:
    chain.wait_for_readings('/left', 1, 2073, 2096)
    for detection in chain.readings['/left']:
        assert detection.child_frame_id == f'left_{NAMES[detection.id]}'
    expected = {'left_beans', 'left_machine'}
    chain.wait(
        lambda: expected <= {one.child_frame_id for one in chain.listener.transforms}, 'transforms'
    )


def test_a_detector_may_leave_tf_alone(chain: Chain) -> None:
    chain.wait_for_readings('/mute', 1, 2107)
    assert {one.child_frame_id for one in chain.readings['/mute']} <= {
        'mute/marker_2096',
        'mute/marker_2107',
    }
    assert not any(one.child_frame_id.startswith('mute') for one in chain.listener.transforms)
    senders = {f'{NAMESPACE}/detector', '/left/detector'}
    chain.wait(lambda: chain.senders_of_tf() >= senders, 'senders of TF')
    assert chain.senders_of_tf() == senders


def test_only_those_on_the_list_come(chain: Chain) -> None:
    chain.wait_for_readings(NAMESPACE, 3, *NAMES)
    chain.wait_for_readings('/left', 2, 2073, 2096)
    chain.wait_for_readings('/mute', 2, 2096, 2107)
    assert {one.id for one in chain.readings['/left']} == {2073, 2096}
    assert {one.id for one in chain.readings['/mute']} == {2096, 2107}


def test_the_driver_tells_latency_clock_offset_and_abnormal_zones(chain: Chain) -> None:
    status = chain.next_diagnostics(f'{NAMESPACE}/driver: frames')
    values = values_of(status)
    assert status.level == DiagnosticStatus.OK, status.message
    assert 0 < float(values['latency [ms]']) < 50
    assert float(values['abnormal zones [%]']) == pytest.approx(100 * len(DARK_ZONES) / 16, abs=0.1)
    message, _ = chain.listener.frames[-5]
    true_ns = chain.sensor.middle_ns[message.sequence] - message.sensor_time * 1000
    assert float(values['clock offset [s]']) == pytest.approx(true_ns * 1e-9, abs=0.05)


def test_the_detector_tells_how_old_the_readings_of_known_markers_are(chain: Chain) -> None:
    def ages(namespace: str) -> dict[str, str]:
        values = values_of(chain.next_diagnostics(f'{namespace}/detector: markers'))
        before, after = 'since last reading of ', ' [s]'
        return {
            key.removeprefix(before).removesuffix(after): value
            for key, value in values.items()
            if key.startswith(before)
        }

    known = ages(NAMESPACE)
    assert set(known) == {'beans', 'machine', 'drone'}
    assert known.pop('drone') == 'never'
    assert all(0 <= float(age) < PATIENCE_S for age in known.values())
    assert set(ages('/mute')) == {'marker_2096', 'marker_2107'}


def test_a_detector_without_frames_is_stale(chain: Chain) -> None:
    name = f'{NAMESPACE}/detector: markers'
    chain.sensor.pull()
    chain.wait(lambda: chain.diagnostics[name][-1].level == DiagnosticStatus.STALE, 'staleness')
    assert chain.diagnostics[name][-1].message.startswith('no frame has come for ')
    chain.sensor.plug()
    chain.wait(lambda: chain.diagnostics[name][-1].level == DiagnosticStatus.OK, 'frames again')


@contextmanager
def in_this_process(make: Callable[[], Node], *arguments: str) -> Iterator[SingleThreadedExecutor]:
    """Make a node here, where its functions can be replaced; it turns when it is spun."""
    rclpy.init(args=['--ros-args', '-r', '__ns:=/lazy', *arguments])
    node, executor = make(), SingleThreadedExecutor()
    executor.add_node(node)
    try:
        yield executor
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown()


@pytest.fixture
def lazy() -> Iterator[Listener]:
    listener = Listener('/lazy')
    yield listener
    listener.close()


def counting(monkeypatch: pytest.MonkeyPatch, module: Any, name: str) -> list[None]:
    """Replace a function of a module by one that counts its calls."""
    calls: list[None] = []
    real = getattr(module, name)

    def counted(*arguments: Any) -> Any:
        calls.append(None)
        return real(*arguments)

    monkeypatch.setattr(module, name, counted)
    return calls


def test_points_and_image_are_made_only_for_those_who_listen(
    lazy: Listener, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    points = counting(monkeypatch, frame_topics, 'to_point_cloud')
    images = counting(monkeypatch, frame_topics, 'to_signal_image')
    packets = map(encode_frame, endless(scene_with_dark_zones()))

    def send_until(done: Callable[[], bool]) -> None:
        def sent_and_done() -> bool:
            port.write(next(packets))
            return done()

        assert lazy.spin_until(sent_and_done, PATIENCE_S)

    def pass_frames() -> None:
        """Wait for frames that were sent from now on."""
        seen = len(lazy.frames) + 20
        send_until(lambda: len(lazy.frames) > seen)

    link = tmp_path / 'port'
    with (
        PortLink(link) as port,
        in_this_process(DriverNode, '-p', f'serial_port:={link}'),
    ):
        pass_frames()
        assert (len(points), len(images)) == (0, 0)
        with subscribed(lazy, PointCloud2, 'points') as clouds:
            send_until(lambda: len(clouds) > 5)
        assert len(points) > 5
        assert not images
        with subscribed(lazy, Image, 'signal_image') as pictures:
            send_until(lambda: len(pictures) > 5)
        pass_frames()
        made = len(points), len(images)
        pass_frames()
        assert (len(points), len(images)) == made


def test_shapes_are_made_only_for_those_who_listen(
    lazy: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn = counting(monkeypatch, detection_topics, 'marker_shapes')
    frames = endless(load_scene('coffee'))
    publisher = lazy.node.create_publisher(FrameMsg, 'frames', 10)
    with in_this_process(DetectorNode) as executor:

        def feed_until(done: Callable[[], bool]) -> None:
            def fed_and_done() -> bool:
                publisher.publish(to_frame_msg(next(frames), FRAME_ID))
                executor.spin_once(timeout_sec=0.005)
                return done()

            assert lazy.spin_until(fed_and_done, PATIENCE_S)

        def pass_readings() -> None:
            seen = len(lazy.markers) + 3
            feed_until(lambda: len(lazy.markers) >= seen)

        assert lazy.spin_until(lambda: publisher.get_subscription_count() > 1, PATIENCE_S)
        pass_readings()
        assert not drawn
        with subscribed(lazy, MarkerArray, 'marker_array') as arrays:
            feed_until(lambda: bool(arrays))
        assert drawn
        pass_readings()
        made = len(drawn)
        pass_readings()
        assert len(drawn) == made


def test_a_port_in_use_is_said_once_and_tried_again(chain: Chain, tmp_path: Path) -> None:
    held, link = tmp_path / 'held', tmp_path / 'port'
    name = '/busy/driver: frames'
    packets = map(encode_frame, endless(load_scene('coffee')))
    with ProcessGroup(tmp_path) as processes, PortLink(held) as port:
        with serial.Serial(str(held), exclusive=True):
            processes.start('driver', node_command('driver', '/busy', serial_port=link))
            absent = f'{link} does not exist; is the sensor plugged in?'
            chain.wait(lambda: bool(chain.diagnostics[name]), 'diagnostics')
            assert chain.diagnostics[name][-1].message == absent
            link.symlink_to(os.readlink(held))
            busy = f'{link} is in use by another program'
            chain.wait(lambda: chain.diagnostics[name][-1].message == busy, busy)
            assert chain.diagnostics[name][-1].level == DiagnosticStatus.ERROR
            chain.next_diagnostics(name)

        def is_well() -> bool:
            port.write(next(packets))
            return bool(chain.diagnostics[name][-1].level == DiagnosticStatus.OK)

        chain.wait(is_well, 'frames')
        processes.check()
        log = processes.log('driver').read_text()
    said = [log.count(line) for line in (f'{absent}; retrying', f'{busy}; retrying')]
    assert (said, log.count(f'reading {link}')) == ([1, 1], 1)
