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
from harness import Sensor, wait_for_readings
from harness_observer import COFFEE_IDS, LATCHED, RELIABLE, System, running, values_of
from harness_readings import HERE, SQUARE, mapped
from harness_tasks import (
    FIXED,
    HAND,
    Hand,
    check_landmarks,
    detection_of,
    squared,
)
from rclpy.time import Time
from std_msgs.msg import Bool
from tf2_msgs.msg import TFMessage

from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_header, to_pose, to_time, to_transform, vector_of
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.nodes.transforms import _LISTENING_S, TransformFinder, TransformSender
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.sensor.frame import Floats
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
    saved = tmp_path / 'room.yaml'
    with running(tmp_path, '/landmarks_alone') as system:
        system.start('landmarks', save_file=saved)
        check_landmarks(system, saved)


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
        assert squared(pose, robot_m) < 16.27
        assert np.linalg.norm(vector_of(pose.pose.pose.position) - robot_m) < 0.05
        answer = system.services.trigger('landmarks/save')
        assert not answer.success
        assert 'while localising no map is made' in answer.message
        answer = system.services.trigger('landmarks/forget')
        assert answer.message == 'the pose is forgotten; the landmarks of load_file stay'
    assert known.read_bytes() == before


def test_no_transform_is_sent_of_a_frame_with_another_parent(tmp_path: Path) -> None:
    with running(tmp_path, '/landmarks_taken') as system:
        system.start('landmarks', child_frame='held_{name}')
        hand = Hand(system)
        mug = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/mug')
        pose = to_pose(HERE, np.array([0.0, 0.0, 0.0, 1.0]))
        taken = to_transform(to_header(time.time_ns(), HAND), 'held_mug', pose)
        publisher = system.node.create_publisher(TFMessage, '/tf_static', LATCHED)
        publisher.publish(TFMessage(transforms=[taken]))
        while not mug:
            for at_m in SQUARE:
                hand.read('mug', 2107, HERE, at_m)
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
def hall(tmp_path_factory: pytest.TempPathFactory) -> Iterator[System]:
    with running(tmp_path_factory.mktemp('impossible'), '/impossible') as system:
        system.start('landmarks')
        system.start('coffee', objects='[mug]')
        system.start('heartbeat', markers='[mug]')
        system.wait(lambda: all(system.statuses[one] for one in NODES.values()), 'the nodes')
        yield system


def test_impossible_detections_are_counted_and_change_nothing(hall: System) -> None:
    system = hall
    mug = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/mug')
    ours = system.collect(PoseWithCovarianceStamped, 'coffee/objects/mug')
    alive = system.collect(Bool, 'heartbeat/alive')
    publisher = system.node.create_publisher(MarkerDetection, 'markers', 1000)
    system.wait(lambda: publisher.get_subscription_count() == 4, 'subscribers')
    names = {reason for *_, reason in IMPOSSIBLE}
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
        for reason in names:
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
    system.wait(lambda: len(mug) > 0 and squared(mug[-1], HERE) < 16.27, 'the mug')
    system.wait(lambda: bool(ours) and any(one.data for one in alive), 'the others')


def test_a_second_marker_of_a_name_and_names_of_one_topic_are_refused(hall: System) -> None:
    system = hall
    hand = Hand(system)
    at_m = np.zeros(3)
    poses = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/a_b')

    def first() -> bool:
        hand.read('a_b', 5, HERE, at_m)
        return bool(poses)

    # Whoever comes first has the name.
    system.wait(first, 'the first of them')

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
    assert poses
    assert all(squared(one, HERE) < 16.27 for one in poses)


def test_a_forgotten_name_leaves_its_topic_to_another(hall: System) -> None:
    system, at_m = hall, np.zeros(3)
    hand = Hand(system)
    poses = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/c_d')
    later = system.collect(PoseWithCovarianceStamped, 'landmarks/objects/later')

    def found(name: str, identity: int, of: list[Any]) -> bool:
        hand.read(name, identity, HERE, at_m)
        return bool(of)

    system.wait(lambda: found('c_d', 8, poses), 'the first of them')
    # Readings come in their order, so none of it is on its way any more.
    system.wait(lambda: found('later', 10, later), 'one that was read after it')
    answer = system.services.trigger('landmarks/forget')
    assert (answer.success, answer.message) == (True, 'all landmarks are forgotten; files stay')
    topic = f'{system.namespace}/landmarks/objects/c_d'
    system.wait(lambda: system.node.count_publishers(topic) == 0, 'that it is forgotten')
    poses.clear()
    system.wait(lambda: found('c.d', 9, poses), 'the other one')
