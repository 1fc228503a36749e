# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms and detections that a test publishes: what nodes make of them, and what is refused."""

import math
import time
from collections.abc import Iterator
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from harness import MAX_MAHALANOBIS, Sensor, wait_for_readings
from harness_observer import COFFEE_IDS, LATCHED, RELIABLE, System, running, values_of
from harness_readings import HERE, SQUARE, mapped
from harness_tasks import FIXED, HAND, Hand, detection_of, deviation_m, squared
from rclpy.time import Time
from std_msgs.msg import Bool
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker as Shape
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import (
    covariance_of,
    to_header,
    to_ns,
    to_pose,
    to_time,
    to_transform,
    vector_of,
)
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.transforms import _LISTENING_S, TransformFinder, TransformSender
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.files import load_yaml
from retrolidar_ros.tasks.survey_files import survey_content


def transform(
    child: str,
    parent: str,
    x_m: float = 1.0,
    stamp_ns: int = 0,
    quaternion: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0),
) -> TransformStamped:
    pose = to_pose(np.array([x_m, 0.0, 0.0]), np.array(quaternion))
    return to_transform(to_header(stamp_ns, parent), child, pose)


@pytest.fixture
def listener() -> Iterator[Listener]:
    listener = Listener('/finding')
    yield listener
    listener.close()


def test_transforms_are_found_between_frames_and_times_and_forgotten(listener: Listener) -> None:
    finder = TransformFinder(listener.node)
    static = listener.node.create_publisher(TFMessage, '/tf_static', LATCHED)
    static.publish(TFMessage(transforms=[transform('hand', 'map')]))
    moving = listener.node.create_publisher(TFMessage, '/tf', 10)
    turned = (0.0, 0.0, math.sin(0.5), math.cos(0.5))

    def find(target: str, source: str, at_s: float) -> tuple[Floats, Floats] | None:
        return finder.find(target, source, Time(nanoseconds=round(at_s * 1e9)))

    def is_found() -> bool:
        before, after = (round(at_s * 1e9) for at_s in (1.0, 3.0))
        both = [transform('eye', 'hand', 1.0, before), transform('eye', 'hand', 3.0, after, turned)]
        moving.publish(TFMessage(transforms=both))
        return find('map', 'eye', 2.0) is not None

    assert listener.spin_until(is_found, 30.0)
    assert finder.parents() == {'hand': 'map', 'eye': 'hand'}
    found = find('map', 'eye', 2.0)
    assert found is not None
    assert found[0] == pytest.approx([3.0, 0.0, 0.0])
    assert found[1][:, 0] == pytest.approx([math.cos(0.5), math.sin(0.5), 0.0])
    back = find('eye', 'map', 2.0)
    assert back is not None
    assert back[1] @ found[0] + back[0] == pytest.approx(np.zeros(3), abs=1e-9)
    for source, at_s in (('eye', 3.000000001), ('eye', 0.999), ('nowhere', 2.0)):
        assert find('map', source, at_s) is None
    finder.forget()
    assert find('map', 'eye', 2.0) is None
    assert find('map', 'hand', 2.0) is not None


def test_frames_that_other_nodes_send_are_named(
    listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    sender = TransformSender(listener.node)
    sender.open()
    sender.send([transform('mug', 'eye', stamp_ns=stamp_ns) for stamp_ns in range(10, 2000)])
    # What was sent long before it comes back is still our own.
    for stamp_ns, child in ((11, 'mug'), (1999, 'mug'), (3, 'jug')):
        sender.on_transforms(TFMessage(transforms=[transform(child, 'eye', stamp_ns=stamp_ns)]))
    assert sender.problem('eye') == ''
    for parent in ('eye', 'other_eye'):
        sender.on_transforms(TFMessage(transforms=[transform('mug', parent, stamp_ns=5000)]))
        assert f'mug (in {parent}): set frame_prefix' in sender.problem('eye')
    assert sender.problem('another eye') == ''
    later_s = time.monotonic() + 100
    monkeypatch.setattr(time, 'monotonic', lambda: later_s)
    assert sender.problem('eye') == ''


def test_sensors_of_the_same_frames_are_warned_of_until_they_have_prefixes(tmp_path: Path) -> None:
    ports = [tmp_path / 'one', tmp_path / 'other']
    scene, name = load_scene('coffee'), '/same1/detector: markers'
    with running(tmp_path, '/same0') as system, Sensor(scene, ports[0]), Sensor(scene, ports[1]):
        for index, port in enumerate(ports):
            own = {'name': f'reader{index}', 'namespace': f'/same{index}'}
            system.start('reader', **own, serial_port=port)
        status = system.wait_for_status(name, DiagnosticStatus.WARN, 'another node sends the TF')
        assert '(in retrolidar_optical_frame)' in status.message
        assert 'another node sends the TF frames' in system.log('reader1')
        system.stop('reader0')
        system.start('reader', serial_port=ports[0], frame_prefix='robot0/')
        prefixed = {'frame_prefix': 'robot0/', 'markers': '[marker_2073]'}
        system.start('heartbeat', **prefixed)
        system.wait_for_status('heartbeat: markers', DiagnosticStatus.OK, 'are read')
        system.markers.clear()
        wait_for_readings(system, COFFEE_IDS)
        for message, _ in system.markers:
            assert message.header.frame_id == 'robot0/retrolidar_optical_frame'
            assert message.child_frame_id == f'robot0/marker_{message.id}'
        for _ in range(round(_LISTENING_S) + 2):  # it has listened once by then
            status = system.next_status('detector: markers')
            assert 'another node' not in status.message


def test_landmarks_are_found_moved_saved_and_forgotten(tmp_path: Path) -> None:
    """A hand that looks from four places finds the mug, and where it is carried to."""
    saved, status = tmp_path / 'room.yaml', NODES['landmarks']
    with running(tmp_path, '/landmarks_alone') as system:
        system.start('landmarks', save_file=saved)
        mug = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/mug')
        shapes = system.collect(MarkerArray, 'landmarks/marker_array')
        hand = Hand(system)
        system.wait_for_status(status, DiagnosticStatus.WARN, 'nothing is placed yet')
        # The topic is made with the first pose; until it is discovered, messages may get lost.
        while not mug:
            hand.read('mug', 2107, HERE, SQUARE[0])
            system.spin_until(lambda: bool(mug), 0.5)
        hand.read('mug', 2107, HERE, SQUARE[1], late_s=0.25)
        for at_m in (*SQUARE[2:], *SQUARE[1:]):
            newest_ns = hand.read('mug', 2107, HERE, at_m)

        def has_all() -> bool:
            # On a busy machine several readings share a pose, and some come after the last one.
            is_newest = abs(to_ns(mug[-1].header.stamp) - newest_ns) < 1000
            return is_newest and deviation_m(mug[-1]) < 0.03

        system.wait(has_all, 'a pose of all readings')
        last = mug[-1]
        assert last.header.frame_id == FIXED
        assert all(squared(one, HERE) < MAX_MAHALANOBIS for one in mug)
        assert np.diag(covariance_of(last.pose))[3:].min() > 1  # one marker has no orientation
        system.wait_for_transforms('landmark_mug')
        frames = {(one.header.frame_id, one.child_frame_id) for one in system.transforms}
        assert {parent for parent, child in frames if child == 'landmark_mug'} == {FIXED}
        system.wait(lambda: bool(shapes), 'shapes')
        kinds = [one.type for one in shapes[-1].markers if one.action == Shape.ADD]
        assert kinds == [Shape.SPHERE, Shape.TEXT_VIEW_FACING]

        values = values_of(system.wait_for_status(status, DiagnosticStatus.OK, '1 placed'))
        assert float(values['mug: baseline [m]']) > 0.5
        assert int(values['mug: readings']) > 6
        success, message = system.services.trigger('landmarks/save')
        assert success, message
        content = load_yaml(saved)
        assert content['frame'] == FIXED
        assert set(content['landmarks']) == {'mug'}
        assert '1 landmarks' in message
        assert str(saved) in message

        there_m = HERE + np.array([0.25, 0.1, 0.2])
        mug.clear()
        for at_m in SQUARE[:3]:
            hand.read('mug', 2107, there_m, at_m)
        system.wait(lambda: bool(mug) and squared(mug[-1], there_m) < MAX_MAHALANOBIS, 'a place')
        for one in mug:
            assert min(squared(one, HERE), squared(one, there_m)) < MAX_MAHALANOBIS
        assert system.services.trigger('landmarks/forget')[0]
        poses = '/landmarks_alone/landmarks/objects/mug'
        system.wait(lambda: system.node.count_publishers(poses) == 0, 'that no old pose is kept')
        success, message = system.services.trigger('landmarks/save')
        assert not success
        assert 'nothing is placed' in message
        assert load_yaml(saved) == content
        system.wait_for_status(status, DiagnosticStatus.WARN, 'nothing is placed yet')


def test_a_robot_is_localised_among_the_landmarks_of_a_file(tmp_path: Path) -> None:
    places = {5: [-0.3, -0.3, 1.5], 6: [0.3, -0.25, 1.2], 8: [0.25, 0.3, 1.4], 9: [-0.3, 0.3, 1.1]}
    estimates = [mapped(f'marker_{one}', np.array(at)) for one, at in places.items()]
    known = tmp_path / 'room.yaml'
    known.write_text(yaml.safe_dump(survey_content('map', estimates)))
    robot_m = np.array([0.02, -0.03, 0.0])
    before = known.read_bytes()
    with running(tmp_path, '/landmarks_robot') as system:
        system.start('landmarks', load_file=known, save_file=known, localize='true')
        poses = system.collect(PoseWithCovarianceStamped, 'landmarks/pose', RELIABLE)
        hand = Hand(system)
        while len(poses) < 6:
            for identity, at in places.items():
                # The hand's own frame is the fixed one here, and the robot is off its origin.
                there_m = np.array(at) - robot_m
                hand.read(f'marker_{identity}', identity, there_m, np.zeros(3))
        pose = poses[-1]
        assert pose.header.frame_id == 'map'
        assert squared(pose, robot_m) < MAX_MAHALANOBIS
        assert np.linalg.norm(vector_of(pose.pose.pose.position) - robot_m) < 0.05
        success, message = system.services.trigger('landmarks/save')
        assert not success
        assert 'while localising no map is made' in message
        _, message = system.services.trigger('landmarks/forget')
        assert message == 'the pose is forgotten; the landmarks of load_file stay'
    assert known.read_bytes() == before


def test_no_transform_is_sent_of_a_frame_with_another_parent(tmp_path: Path) -> None:
    with running(tmp_path, '/landmarks_taken') as system:
        system.start('landmarks', child_frame='held_{name}')
        hand = Hand(system)
        mug = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/mug')
        static = system.node.create_publisher(TFMessage, '/tf_static', LATCHED)
        static.publish(TFMessage(transforms=[transform('held_mug', HAND)]))
        hand.show('mug', 2107, HERE, mug)
        told = f'no transform from {FIXED} to held_mug is sent: its parent in TF is {HAND}'
        system.wait(lambda: told in system.log('landmarks'), 'a refusal')
        system.transforms.clear()
        mug.clear()
        hand.read('mug', 2107, HERE, SQUARE[0])
        system.wait(lambda: bool(mug), 'a pose')
        assert not [one for one in system.transforms if one.child_frame_id == 'held_mug']
        assert system.log('landmarks').count(told) == 1


NODES = {
    'landmarks': 'landmarks: landmarks',
    'coffee': 'coffee: objects',
    'heartbeat': 'heartbeat: markers',
}

NO_NAME, STAMP = 'child_frame_id is not a TF name', 'the stamp is far'
NO_TURN = 'the orientation is not a unit'
INFINITE, FLAT = 'the covariance is not finite', 'the covariance is not positive definite'
IMPOSSIBLE: list[tuple[str, Any, str]] = [
    ('child_frame_id', '', NO_NAME),
    ('child_frame_id', 'm' * 300, NO_NAME),
    ('child_frame_id', 'mug\nmug', NO_NAME),
    ('child_frame_id', HAND, 'child_frame_id is the frame of the sensor'),
    ('header.frame_id', '', 'frame_id is not a TF name'),
    ('id', 4096, 'the ID is not below 4096'),
    ('header.stamp', lambda: to_time(time.time_ns() - 7200 * 10**9), STAMP),
    ('header.stamp', lambda: to_time(time.time_ns() + 60 * 10**9), STAMP),
    ('header.stamp.sec', -5, STAMP),
    ('pose.pose.position.z', math.nan, 'the position is not in front'),
    ('pose.pose.position.z', -1.0, 'the position is not in front'),
    ('range', math.nan, 'impossible range'),
    ('range', math.inf, 'impossible range'),
    ('range', 0.0, 'impossible range'),
    ('range_stddev', 0.0, 'impossible range_stddev'),
    ('range_stddev', math.nan, 'impossible range_stddev'),
    ('pose.pose.orientation.w', math.nan, NO_TURN),
    ('pose.pose.orientation.w', 5.0, NO_TURN),
    ('pose.covariance', np.full(36, math.nan), INFINITE),
    ('pose.covariance', np.full(36, 1e300), INFINITE),
    ('pose.covariance', np.zeros(36), FLAT),
    ('pose.covariance', -np.eye(6).ravel(), FLAT),
    ('pose.covariance', np.triu(np.ones((6, 6))).ravel(), 'the covariance is not symmetric'),
]
"""A field of a detection, what it cannot be or makes that, and why that is refused."""


@pytest.fixture(scope='module')
def system(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    with running(tmp_path_factory.mktemp('impossible'), '/impossible') as system:
        system.start('landmarks')
        system.start('coffee', objects='[mug]')
        system.start('heartbeat', markers='[mug]')
        system.wait(lambda: all(system.statuses[one] for one in NODES.values()), 'the nodes')
        yield system


def test_impossible_detections_are_counted_and_change_nothing(system: System) -> None:
    mug = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/mug')
    ours = system.collect(PoseWithCovarianceStamped, 'coffee/objects/mug')
    alive = system.collect(Bool, 'heartbeat/alive')
    publisher = system.node.create_publisher(MarkerDetection, 'markers', 1000)
    system.wait(lambda: publisher.get_subscription_count() == 4, 'subscribers')
    seen = {name: len(system.statuses[name]) for name in NODES.values()}
    for field, value, _ in IMPOSSIBLE:
        message = detection_of('mug', 2107, HERE, time.time_ns())
        *owner, name = field.split('.')
        given = value() if callable(value) else value
        setattr(attrgetter('.'.join(owner))(message) if owner else message, name, given)
        publisher.publish(message)

    def counted(name: str) -> int:
        values = values_of(system.statuses[name][-1])
        return sum(int(one) for key, one in values.items() if key.startswith('refused: '))

    def all_counted() -> bool:
        return all(counted(name) == len(IMPOSSIBLE) for name in NODES.values())

    system.wait(all_counted, 'all to be counted')
    for node, name in NODES.items():
        values = values_of(system.statuses[name][-1])
        for *_, reason in IMPOSSIBLE:
            assert any(reason in key for key in values), reason
        told = [one for one in system.statuses[name][seen[name] :] if 'refused' in one.message]
        assert {one.level for one in told} == {DiagnosticStatus.ERROR}
        assert 'detection refused: ' in system.log(node)
    assert not mug
    assert not ours
    assert not any(one.data for one in alive)
    # And what can be is read as before.
    hand = Hand(system)
    for at_m in SQUARE:
        hand.read('mug', 2107, HERE, at_m)
    system.wait(lambda: bool(mug) and squared(mug[-1], HERE) < MAX_MAHALANOBIS, 'the mug')
    system.wait(lambda: bool(ours) and any(one.data for one in alive), 'the others')


def test_a_second_marker_of_a_name_and_names_of_one_topic_are_refused(system: System) -> None:
    hand, at_m = Hand(system), np.zeros(3)
    poses = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/a_b')
    hand.show('a_b', 5, HERE, poses)  # whoever comes first has the name

    def both() -> bool:
        hand.read('a_b', 5, HERE, at_m)
        hand.read('a_b', 6, HERE, at_m)
        hand.read('a.b', 7, HERE + 0.1, at_m)
        values = values_of(system.statuses[NODES['landmarks']][-1])
        return {
            'refused: two markers have one name, each needs its own',
            'refused: two names would share a topic, rename one',
        } <= values.keys()

    system.wait(both, 'both refusals')
    assert all(squared(one, HERE) < MAX_MAHALANOBIS for one in poses)


def test_a_forgotten_name_leaves_its_topic_to_another(system: System) -> None:
    hand = Hand(system)
    poses = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/c_d')
    later = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/later')
    hand.show('c_d', 8, HERE, poses)
    # Readings come in their order, so none of it is on its way any more.
    hand.show('later', 10, HERE, later)
    answer = system.services.trigger('landmarks/forget')
    assert answer == (True, 'all landmarks are forgotten; files stay')
    topic = f'{system.namespace}/landmarks/objects/c_d'
    system.wait(lambda: system.node.count_publishers(topic) == 0, 'that it is forgotten')
    poses.clear()
    hand.show('c.d', 9, HERE, poses)
