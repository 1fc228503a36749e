# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What driver and detector offer beside frames and detections, and only while somebody listens."""

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseStamped
from harness import PATIENCE_S, Sensor
from harness_frames import make_frames
from harness_observer import FRAME_ID, System, in_this_process, running, values_of
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from visualization_msgs.msg import Marker, MarkerArray

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection, MarkerDetectionArray
from retrolidar_ros.nodes import detector_topics, driver
from retrolidar_ros.nodes.conversion import (
    covariance_of,
    from_frame_msg,
    quaternion_in,
    to_camera_info,
    to_depth_image,
    to_header,
    to_ns,
    to_point_cloud,
    to_signal_image,
    vector_of,
)
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.sensor.frame import Frame, valid_samples
from retrolidar_ros.sensor.model import Status
from retrolidar_ros.sensor.rotation import matrix_of

DARK_ZONES = {0, 15}
MARKER_FILE = 'markers: {2073: {frame: beans}, 2096: {frame: machine}, 2127: {frame: drone}}'
NAMES = {2073: 'beans', 2096: 'machine', 2107: 'marker_2107'}
READ = {'/topics': set(NAMES), '/left': {2073, 2096}, '/mute': {2096, 2107}}
"""What is read in each namespace."""


@dataclass
class Chain:
    """A sensor, its driver, and three detectors."""

    system: System
    sensor: Sensor
    readings: dict[str, list[MarkerDetection]]
    """By namespace."""

    def frames(self) -> dict[int, FrameMsg]:
        return {to_ns(message.header.stamp): message for message, _ in self.system.frames}


@pytest.fixture(scope='module')
def chain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chain]:
    directory = tmp_path_factory.mktemp('topics')
    known = directory / 'markers.yaml'
    known.write_text(MARKER_FILE)
    frames = ('-r', 'frames:=/topics/frames')
    scene = load_scene('coffee')
    *others, wall = scene.surfaces
    lit = tuple(zone for zone in wall.zones or () if zone not in DARK_ZONES)
    scene = replace(scene, surfaces=(*others, replace(wall, zones=lit)))
    with running(directory, '/topics') as system, Sensor(scene, system.port) as sensor:
        readings = {one: system.collect(MarkerDetection, f'{one}/markers', 100) for one in READ}
        system.start('driver', serial_port=system.port)
        system.start('detector', marker_file=known)
        left = {'marker_file': known, 'only_registered': 'true', 'child_frame': 'left_{name}'}
        system.start('detector', *frames, name='left', namespace='/left', method='paper', **left)
        mute = {'registered_ids': [2096, 2107], 'child_frame': 'mute/{name}', 'publish_tf': 'false'}
        system.start('detector', *frames, name='mute', namespace='/mute', **mute)

        def are_read() -> bool:
            counts = {name: Counter(one.id for one in found) for name, found in readings.items()}
            return all(counts[name][one] >= 2 for name, ids in READ.items() for one in ids)

        system.wait(are_read, 'all markers twice')
        yield Chain(system, sensor, readings)


@pytest.mark.parametrize('side', [4, 8])
def test_standard_messages_are_what_each_zone_saw(side: int) -> None:
    (frame,) = make_frames(1, side)
    status = np.where(np.arange(side * side) % 3, Status.VALID, Status.NO_TARGET)
    frame = replace(frame, status=status.astype(np.uint8))
    header = to_header(frame.stamp_ns, FRAME_ID)
    valid, _ = valid_samples(frame.signal, frame.distance, frame.status)
    depth = np.where(valid, frame.distance, np.nan)
    assert 0 < np.isfinite(depth).sum() < side * side

    cloud = to_point_cloud(frame, FRAME_ID)
    assert (cloud.header, cloud.height, cloud.width) == (header, side, side)
    assert (cloud.point_step, cloud.row_step, cloud.is_bigendian) == (20, 20 * side, False)
    assert [field.name for field in cloud.fields] == ['x', 'y', 'z', 'signal', 'ambient']
    assert [field.offset for field in cloud.fields] == [0, 4, 8, 12, 16]
    assert {field.datatype for field in cloud.fields} == {PointField.FLOAT32}
    assert not cloud.is_dense
    points = np.frombuffer(bytes(cloud.data), dtype='<f4').reshape(-1, 5)
    expected = np.column_stack([depth[:, None] * frame.grid.tangents, depth])
    np.testing.assert_allclose(points[:, :3], expected, rtol=1e-6)
    np.testing.assert_array_equal(points[:, 3:].T, [frame.signal, frame.ambient])

    for image, values in (
        (to_signal_image(frame, FRAME_ID), frame.signal),
        (to_depth_image(frame, FRAME_ID), depth),
    ):
        assert (image.header, image.height, image.width) == (header, side, side)
        assert (image.encoding, image.step, image.is_bigendian) == ('32FC1', 4 * side, 0)
        np.testing.assert_array_equal(np.frombuffer(bytes(image.data), '<f4'), values)

    camera = to_camera_info(frame, FRAME_ID)
    assert (camera.header, camera.height, camera.width) == (header, side, side)
    row, column = np.divmod(np.arange(side * side), side)
    pixels = np.stack([column, row, np.ones(side * side)])
    rays = np.linalg.solve(np.array(camera.k).reshape(3, 3), pixels)
    assert pytest.approx(frame.grid.tangents) == rays[:2].T


def test_each_frame_has_its_standard_messages(chain: Chain) -> None:
    kinds: dict[str, tuple[Any, Callable[[Frame, str], Any]]] = {
        'points': (PointCloud2, to_point_cloud),
        'signal_image': (Image, to_signal_image),
        'depth/image_raw': (Image, to_depth_image),
        'depth/camera_info': (CameraInfo, to_camera_info),
    }
    for topic, (kind, convert) in kinds.items():
        with chain.system.subscribed(kind, topic) as messages:
            chain.system.wait(lambda came=messages: len(came) >= 5, topic)  # type: ignore[misc]
        last_ns = to_ns(messages[-1].header.stamp)
        chain.system.wait(lambda end=last_ns: end in chain.frames(), 'its frame')  # type: ignore[misc]
        for message in messages:
            frame = chain.frames()[to_ns(message.header.stamp)]
            # As text, for a NaN is not equal to itself.
            assert str(message) == str(convert(from_frame_msg(frame), FRAME_ID))


def test_the_detections_of_a_frame_come_in_one_array_with_its_stamp(chain: Chain) -> None:
    readings = chain.readings['/topics']
    seen = len(readings)
    with chain.system.subscribed(MarkerDetectionArray, 'markers_array') as arrays:
        chain.system.wait(lambda: sum(len(one.detections) for one in arrays) >= 6, 'arrays')
        chain.system.wait(lambda: arrays[-1].detections[-1] in readings[seen:], 'its detections')
    found = [detection for array in arrays for detection in array.detections]
    first = readings.index(found[0])
    assert readings[first : first + len(found)] == found
    for array in arrays:
        assert array.header.frame_id == FRAME_ID
        assert to_ns(array.header.stamp) in chain.frames()
        assert max(to_ns(one.end) for one in array.detections) <= to_ns(array.header.stamp)
    stamps = [to_ns(array.header.stamp) for array in arrays]
    assert stamps == sorted(set(stamps))


def test_detections_are_drawn_with_their_uncertainty(chain: Chain) -> None:
    with chain.system.subscribed(MarkerArray, 'marker_array') as arrays:
        chain.system.wait(lambda: sum(len(array.markers) for array in arrays) >= 6, 'shapes')
    shapes = [shape for array in arrays for shape in array.markers]
    last_ns = max(to_ns(shape.header.stamp) for shape in shapes)
    read = chain.readings['/topics']
    chain.system.wait(lambda: to_ns(read[-1].header.stamp) > last_ns, 'a later reading')
    found = {(one.id, to_ns(one.header.stamp)): one for one in read}
    for ellipsoid, label in zip(shapes[::2], shapes[1::2], strict=True):
        detection = found[ellipsoid.id, to_ns(ellipsoid.header.stamp)]
        assert ellipsoid.header == label.header == detection.header
        assert (ellipsoid.type, label.type) == (Marker.SPHERE, Marker.TEXT_VIEW_FACING)
        assert (ellipsoid.lifetime.sec, ellipsoid.lifetime.nanosec) == (4, 0)
        assert label.text == f'{detection.child_frame_id}\n{detection.range:.3f} m'
        assert ellipsoid.pose.position == detection.pose.pose.position
        # The half axes are two standard deviations.
        axes = matrix_of(quaternion_in(ellipsoid.pose.orientation))
        drawn = axes * (vector_of(ellipsoid.scale) / 4) ** 2 @ axes.T
        covariance = covariance_of(detection.pose)[:3, :3]
        np.testing.assert_allclose(drawn, covariance, atol=0.0025**2)


def test_ids_names_and_transforms_are_those_of_the_parameters(chain: Chain) -> None:
    prefixes = {'/topics': '', '/left': 'left_', '/mute': 'mute/'}
    for namespace, prefix in prefixes.items():
        names = NAMES if namespace != '/mute' else {}
        found = {one.id: one.child_frame_id for one in chain.readings[namespace]}
        expected = {one: prefix + names.get(one, f'marker_{one}') for one in READ[namespace]}
        assert found == expected
    chain.system.wait_for_transforms(*NAMES.values(), 'left_beans', 'left_machine')
    publishers = chain.system.node.get_publishers_info_by_topic('/tf')
    senders = {f'{one.node_namespace}/{one.node_name}' for one in publishers}
    assert senders == {'/topics/detector', '/left/detector'}


def test_poses_of_known_markers_come_by_their_names(chain: Chain) -> None:
    with chain.system.subscribed(PoseStamped, 'poses/beans') as poses:

        def is_heard() -> bool:
            beans = [one for one in chain.readings['/topics'] if one.child_frame_id == 'beans']
            return bool(poses) and poses[-1].pose in [one.pose.pose for one in beans]

        chain.system.wait(is_heard, 'poses')


def test_the_driver_reports_latency_clock_offset_and_abnormal_zones(chain: Chain) -> None:
    status = chain.system.next_status('driver: frames')
    values = values_of(status)
    assert status.level == DiagnosticStatus.OK, status.message
    assert 0 < float(values['latency [ms]']) < 50
    assert float(values['abnormal zones [%]']) == pytest.approx(100 * len(DARK_ZONES) / 16, abs=0.1)
    message, _ = chain.system.frames[-5]
    true_ns = chain.sensor.middle_ns[message.sequence] - message.sensor_time * 1000
    assert float(values['clock offset [s]']) == pytest.approx(true_ns * 1e-9, abs=0.05)


def test_the_detector_reports_the_ages_of_the_readings_of_known_markers(chain: Chain) -> None:
    values = values_of(chain.system.next_status('detector: markers'))
    age = 'since last reading of {} [s]'
    assert values[age.format('drone')] == 'never'
    for name in ('beans', 'machine'):
        assert 0 <= float(values[age.format(name)]) < PATIENCE_S
    # Another has no file, but a list.
    muted = values_of(chain.system.next_status('/mute/detector: markers'))
    assert {age.format(f'marker_{one}') for one in (2096, 2107)} <= muted.keys()


MADE = {
    'points': (PointCloud2, driver, 'to_point_cloud'),
    'signal_image': (Image, driver, 'to_signal_image'),
    'markers_array': (MarkerDetectionArray, detector_topics, 'to_array'),
    'marker_array': (MarkerArray, detector_topics, 'marker_shapes'),
}
"""By topic: its type, and the function of a module that makes its messages."""


def test_messages_for_nobody_are_not_made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    makers = {topic: Mock(wraps=getattr(of, name)) for topic, (_, of, name) in MADE.items()}
    for topic, (_, module, name) in MADE.items():
        monkeypatch.setattr(module, name, makers[topic])
    with (
        running(tmp_path, '/lazy') as system,
        Sensor(load_scene('coffee'), system.port),
        in_this_process(system, '-p', f'serial_port:={system.port}'),
    ):

        def pass_readings() -> None:
            """Wait for frames and readings of them that came from now on."""
            frames, markers = len(system.frames) + 20, len(system.markers) + 2
            system.wait_for_frames(frames)
            system.wait(lambda: len(system.markers) >= markers, 'readings')

        def made() -> set[str]:
            return {topic for topic, maker in makers.items() if maker.called}

        pass_readings()
        assert not made()
        for topic, (kind, *_) in MADE.items():
            with system.subscribed(kind, topic) as came:
                system.wait(lambda came=came: len(came) > 2, topic)  # type: ignore[misc]
            pass_readings()  # until it is noticed that nobody subscribes any more
            assert made() == {topic}
            makers[topic].reset_mock()
        pass_readings()
        assert not made()
