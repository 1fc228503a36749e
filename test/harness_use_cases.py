# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is asserted of coffee, heartbeat and two sensors, however their nodes were started."""

import time
from collections.abc import Callable
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, Vector3Stamped
from harness import PATIENCE_S
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool, String
from tf2_msgs.msg import TFMessage

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.scene.description import Marker, Scene
from retrolidar_ros.scene.files import find_scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_yaml

SENSOR_FRAME = 'retrolidar_optical_frame'
OBJECTS = ('beans', 'machine', 'mug')
SIDES = ('left', 'right')
OVERDUE_AFTER_S = 2.0
# A position is further off in one of a thousand cases, were its error normal.
_MOST_MAHALANOBIS = 16.27
# The nodes look at the time ten times a second; the rest is for a machine that is busy.
_LATENESS_S = 1.0

_LATCHED = QoSProfile(  # type: ignore[no-untyped-call]
    depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL
)
RELIABLE = QoSProfile(depth=1000)  # type: ignore[no-untyped-call]


class View(NamedTuple):
    """A frame in which poses are told, and how the sensor lies in it."""

    frame: str
    rotation: Floats
    """Shape (3, 3), from the sensor's optical frame."""
    translation_m: Floats

    def of(self, position_m: Floats) -> Floats:
        """Return where a place of the optical frame is in this one."""
        place: Floats = self.rotation @ position_m + self.translation_m
        return place


SENSOR_VIEW = View(SENSOR_FRAME, np.eye(3), np.zeros(3))
# A base with x forward, y left and z up; the sensor looks forward (REP 103).
BASE_VIEW = View(
    'base',
    np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]),
    np.array([0.25, -0.1, 0.8]),
)
_BASE_QUATERNION = (-0.5, 0.5, -0.5, 0.5)


class Collected:
    """Messages of a topic, each with the time of its receipt [s]."""

    def __init__(
        self, listener: Listener, kind: Any, topic: str, qos: QoSProfile = _LATCHED
    ) -> None:
        self.messages: list[Any] = []
        self.times_s: list[float] = []
        listener.node.create_subscription(kind, topic, self._take, qos)

    def _take(self, message: Any) -> None:
        self.messages.append(message)
        self.times_s.append(time.monotonic())

    def data(self) -> list[Any]:
        return [message.data for message in self.messages]

    def clear(self) -> None:
        self.messages.clear()
        self.times_s.clear()


class Health:
    """What a node says of itself on /diagnostics, as `/namespace/node: subject`."""

    def __init__(self, listener: Listener, name: str) -> None:
        self.name = name
        self.statuses: list[DiagnosticStatus] = []
        self._listener = listener
        listener.node.create_subscription(DiagnosticArray, '/diagnostics', self._take, 10)

    def _take(self, message: DiagnosticArray) -> None:
        self.statuses += [status for status in message.status if status.name == self.name]

    def wait_for(self, level: bytes, text: str) -> dict[str, str]:
        """Wait until it is of a level and says a text from now on; return the values."""
        told = len(self.statuses)

        def found() -> list[DiagnosticStatus]:
            return [
                status
                for status in self.statuses[told:]
                if status.level == level and status.message == text
            ]

        wait(
            self._listener,
            lambda: bool(found()),
            lambda: f'{self.name}: {text!r} of level {level!r}, only {self.statuses[told:]}',
        )
        return {value.key: value.value for value in found()[0].values}


def wait(listener: Listener, done: Callable[[], bool], what: Callable[[], str]) -> None:
    assert listener.spin_until(done, PATIENCE_S), f'waited in vain for {what()}'


def check_place(position_m: Floats, covariance: Floats, truth_m: Floats, eye_m: Floats) -> None:
    """A place is as far from the eye of the sensor as the truth is, and as sure as it says."""
    error = position_m - truth_m
    range_m = float(np.linalg.norm(truth_m - eye_m))
    assert abs(np.linalg.norm(position_m - eye_m) - range_m) < 0.01
    assert np.linalg.norm(error) < 0.16 * range_m  # within its zone
    assert np.allclose(covariance, covariance.T)
    variances = np.linalg.eigvalsh(covariance)
    assert variances.min() > 0
    assert np.sqrt(variances.max()) < 0.12 * range_m
    assert error @ np.linalg.solve(covariance, error) < _MOST_MAHALANOBIS


def check_coffee(listener: Listener, scene: Scene, namespace: str, view: View) -> None:
    """All objects are found; who asks only then hears of it, and where they are."""
    health = Health(listener, f'{namespace}/coffee: objects')
    values = health.wait_for(DiagnosticStatus.OK, '3 objects placed')
    assert values == dict.fromkeys(OBJECTS, 'placed')
    # Now that this has been said once and for all, these join late.
    topic = f'{namespace}/coffee'
    ready = Collected(listener, Bool, f'{topic}/ready')
    missing = Collected(listener, String, f'{topic}/missing')
    poses = {
        name: Collected(listener, PoseWithCovarianceStamped, f'{topic}/objects/{name}')
        for name in OBJECTS
    }
    offsets = {
        pair: Collected(listener, Vector3Stamped, f'{topic}/offsets/{pair[0]}_to_{pair[1]}')
        for pair in (('beans', 'machine'), ('beans', 'mug'), ('machine', 'mug'))
    }
    every = [ready, missing, *poses.values(), *offsets.values()]
    wait(listener, lambda: all(one.messages for one in every), lambda: 'every topic of coffee')
    assert ready.data() == [True]
    assert missing.data() == ['']

    markers = {marker.name: marker for marker in scene.markers}
    wait(listener, lambda: _has_origins(listener, poses), lambda: 'what the poses were made of')
    for name, pose in poses.items():
        _check_pose(listener, markers[name], pose.messages[-1], view)
    wait(listener, lambda: _agree(poses, offsets), lambda: 'offsets that are those of the poses')
    for (one, other), offset in offsets.items():
        ends = [poses[name].messages[-1] for name in (one, other)]
        covariance = sum(_covariance(end)[:3, :3] for end in ends)
        truth = view.of(np.array(markers[other].position_m)) - view.of(
            np.array(markers[one].position_m)
        )
        error = _vector(offset.messages[-1].vector) - truth
        assert error @ np.linalg.solve(covariance, error) < _MOST_MAHALANOBIS
    _check_demand(listener, topic, ready, missing, view)


def _vector(message: Any) -> Floats:
    return np.array([message.x, message.y, message.z])


def _position(pose: PoseWithCovarianceStamped) -> Floats:
    return _vector(pose.pose.pose.position)


def _covariance(pose: Any) -> Floats:
    return np.array(pose.pose.covariance).reshape(6, 6)


def _origin(listener: Listener, name: str, stamp: Any) -> tuple[Any, TransformStamped] | None:
    """Return detection and transform of a marker at a time, as far as both were heard."""
    for message, _ in listener.markers:
        if message.child_frame_id == name and message.header.stamp == stamp:
            for transform in listener.transforms:
                if transform.child_frame_id == name and transform.header.stamp == stamp:
                    return message, transform
    return None


def _has_origins(listener: Listener, poses: dict[str, Collected]) -> bool:
    return all(
        _origin(listener, name, pose.messages[-1].header.stamp) for name, pose in poses.items()
    )


def _check_pose(
    listener: Listener, marker: Marker, pose: PoseWithCovarianceStamped, view: View
) -> None:
    """A pose is that of the detection, turned into the view, and true."""
    assert pose.header.frame_id == view.frame
    origin = _origin(listener, marker.name, pose.header.stamp)
    assert origin is not None
    detection, transform = origin
    assert detection.id == marker.id
    assert detection.header.frame_id == transform.header.frame_id == SENSOR_FRAME
    seen = _vector(detection.pose.pose.position)
    assert np.array_equal(_vector(transform.transform.translation), seen)
    assert transform.transform.rotation == detection.pose.pose.orientation

    position, covariance = _position(pose), _covariance(pose)
    truth = view.of(np.array(marker.position_m))
    check_place(position, covariance[:3, :3], truth, view.translation_m)
    if view is not SENSOR_VIEW:
        return  # it is made of all detections so far
    assert np.allclose(position, seen)
    assert np.allclose(covariance, _covariance(detection))
    # Facing the sensor: the marker's z points away from it.
    turn = pose.pose.pose.orientation
    away = position - view.translation_m
    axis = matrix_of(np.array([turn.x, turn.y, turn.z, turn.w]))[:, 2]
    assert np.allclose(axis, away / np.linalg.norm(away))


def _agree(poses: dict[str, Collected], offsets: dict[tuple[str, str], Collected]) -> bool:
    """Tell whether each offset leads from one pose to the other, as of the later of the two."""
    for pair, offset in offsets.items():
        one, other = (poses[name].messages[-1] for name in pair)
        latest = offset.messages[-1]
        if to_ns(latest.header.stamp) != max(to_ns(end.header.stamp) for end in (one, other)):
            return False
        if latest.header.frame_id != one.header.frame_id:
            return False
        if not np.allclose(_vector(latest.vector), _position(other) - _position(one)):
            return False
    return True


def _check_demand(
    listener: Listener, topic: str, ready: Collected, missing: Collected, view: View
) -> None:
    """Who wants more than a zone can tell is told what is missing and why, until he does not."""
    unsure, stale = 'is known to 0.*; {} m wanted*', 'was last seen ? s ago'
    # The beans are 1 m away, which makes a zone small enough for the first of these.
    steps: list[tuple[str, float, dict[str, str]]] = [
        ('max_stddev', 0.055, dict.fromkeys(OBJECTS[1:], unsure.format(0.055))),
        ('max_stddev', 0.01, dict.fromkeys(OBJECTS, unsure.format(0.01))),
        ('stale_after', 0.1, dict.fromkeys(OBJECTS, stale)),
        ('stale_after', 10.0, dict.fromkeys(OBJECTS, unsure.format(0.01))),
        ('max_stddev', 0.2, {}),
    ]
    # Landmarks are a bit less sure than single detections.
    for parameter, number, expected in steps[view is not SENSOR_VIEW :]:
        missing.clear()
        _set_number(listener, topic, parameter, number)
        _wait_for_missing(listener, ready, missing, expected)


def _wait_for_missing(
    listener: Listener, ready: Collected, missing: Collected, expected: dict[str, str]
) -> None:
    pattern = ', '.join(f'{name} {reason}' for name, reason in expected.items())

    def is_told() -> bool:
        said = any(fnmatchcase(text, pattern) for text in missing.data())
        return said and ready.data()[-1] is not bool(expected)

    wait(listener, is_told, lambda: f'{pattern!r}, only {missing.data()} {ready.data()}')


def _set_number(listener: Listener, node: str, name: str, number: float) -> None:
    client = listener.node.create_client(SetParameters, f'{node}/set_parameters')
    wait(listener, client.service_is_ready, lambda: f'the parameters of {node}')
    value = ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=number)
    request = SetParameters.Request(parameters=[Parameter(name=name, value=value)])
    future: Any = client.call_async(request)
    wait(listener, future.done, lambda: f'{name} to be set')
    (result,) = future.result().results
    assert result.successful, result.reason


def publish_base(listener: Listener) -> None:
    """Say once and for all how the sensor lies in the frame `base`."""
    transform = TransformStamped()
    transform.header.frame_id, transform.child_frame_id = BASE_VIEW.frame, SENSOR_FRAME
    turn, way = transform.transform.rotation, transform.transform.translation
    way.x, way.y, way.z = BASE_VIEW.translation_m.tolist()
    turn.x, turn.y, turn.z, turn.w = _BASE_QUATERNION
    publisher = listener.node.create_publisher(TFMessage, '/tf_static', _LATCHED)
    publisher.publish(TFMessage(transforms=[transform]))


def silent_drone(directory: Path, start_s: float, packets: int) -> Path:
    """Write the scene of a drone that falls silent; return its path."""
    scene = load_yaml(find_scene('drone'))
    (marker,) = scene['markers']
    # It hangs still: where it goes from zone to zone, a packet may be missed.
    del marker['wander'], marker['occlusion']
    marker |= {'start': f'{start_s} s', 'packets': packets}
    path = directory / 'silent_drone.yaml'
    path.write_text(yaml.safe_dump(scene))
    return path


def impatient_parameters(directory: Path) -> Path:
    """Write a copy of the shipped parameters with a short `overdue_after`; return its path."""
    parameters = load_yaml(shared_file('config/retrolidar.yaml'))
    parameters['/**/heartbeat']['ros__parameters']['overdue_after'] = OVERDUE_AFTER_S
    path = directory / 'impatient.yaml'
    path.write_text(yaml.safe_dump(parameters))
    return path


def check_heartbeat(listener: Listener, alive: Collected, health: Health, scene: Scene) -> None:
    """A drone is alive from its first reading on, and overdue some time after its last."""
    (marker,) = scene.markers
    assert marker.packets is not None
    wait(listener, lambda: bool(listener.markers), lambda: 'a reading')
    wait(listener, lambda: alive.data()[-1:] == [True], lambda: f'life, only {alive.data()}')
    alive.clear()
    values = health.wait_for(DiagnosticStatus.OK, 'all markers are read')
    assert int(values['drone: readings']) >= 1
    assert float(values['drone: silence [s]']) <= OVERDUE_AFTER_S
    wait(listener, lambda: bool(alive.messages), lambda: 'silence to be noticed')
    assert alive.data() == [False]  # and it was alive between its readings
    messages = [message for message, _ in listener.markers]
    assert {(one.id, one.child_frame_id) for one in messages} == {(marker.id, 'drone')}
    last_s = listener.markers[-1][1] * 1e-9 - time.time() + time.monotonic()
    assert abs(alive.times_s[0] - last_s - OVERDUE_AFTER_S) < _LATENESS_S
    values = health.wait_for(DiagnosticStatus.WARN, 'overdue: drone')
    assert len(messages) <= int(values['drone: readings']) <= marker.packets
    silence_s = float(values['drone: silence [s]'])
    assert silence_s > OVERDUE_AFTER_S
    assert float(values['drone: longest silence [s]']) >= silence_s


def check_two_sensors(listener: Listener, scene: Scene, namespace: str) -> None:
    """What both sensors see comes on one topic, and each marker has one TF frame below each."""
    frames = {
        side: Collected(listener, FrameMsg, f'{namespace}/{side}/frames', RELIABLE)
        for side in SIDES
    }
    markers = {f'{side}_{one.name}': one for side in SIDES for one in scene.markers}
    wait(listener, lambda: all(one.messages for one in frames.values()), lambda: 'both sensors')
    listener.markers.clear()  # they may be of frames that came before these were heard

    def missing() -> set[str]:
        transforms = {(one.child_frame_id, to_ns(one.header.stamp)) for one in listener.transforms}
        messages = [message for message, _ in listener.markers]
        placed = {(one.child_frame_id, to_ns(one.header.stamp)) for one in messages} & transforms
        return set(markers) - {name for name, _ in placed}

    wait(listener, lambda: not missing(), lambda: f'detection and transform of {missing()}')
    stamps = {}
    for side, collected in frames.items():
        assert {one.header.frame_id for one in collected.messages} == {f'{side}_optical_frame'}
        stamps[side] = {to_ns(one.header.stamp) for one in collected.messages}
    assert stamps['left'] & stamps['right'] == set()
    for message, _ in listener.markers:
        side, _, name = message.child_frame_id.partition('_')
        marker = markers[message.child_frame_id]
        assert (message.id, name) == (marker.id, marker.name)
        assert message.header.frame_id == f'{side}_optical_frame'
        assert to_ns(message.end) in stamps[side]
        position = _vector(message.pose.pose.position)
        truth = np.array(marker.position_m)
        check_place(position, _covariance(message)[:3, :3], truth, np.zeros(3))
    parents = {
        (one.child_frame_id, one.header.frame_id)
        for one in listener.transforms
        if one.header.frame_id in {f'{side}_optical_frame' for side in SIDES}
    }
    assert parents == {(name, f'{name.partition("_")[0]}_optical_frame') for name in markers}
