# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is asserted of the task coffee, however its nodes were started."""

from fnmatch import fnmatchcase
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped, Vector3Stamped
from harness_observer import LATCHED, Observer, values_of
from harness_use_cases import MOST_MAHALANOBIS, check_place
from std_msgs.msg import Bool, Header, String
from tf2_msgs.msg import TFMessage

from retrolidar_ros.nodes.conversion import (
    covariance_of,
    quaternion_in,
    to_ns,
    to_pose,
    to_transform,
    vector_of,
)
from retrolidar_ros.scene.description import Marker, Scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of, quaternion_of

SENSOR_FRAME = 'retrolidar_optical_frame'
OBJECTS = ('beans', 'machine', 'mug')


class View(NamedTuple):
    """A frame in which poses are published, and how the sensor lies in it."""

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


def check_coffee(observer: Observer, scene: Scene, node: str, view: View) -> None:
    """All objects are found; subscribers that join later get that, and where they are."""
    status = observer.wait_for_status(f'{node}: objects', DiagnosticStatus.OK, '3 objects placed')
    assert values_of(status) == dict.fromkeys(OBJECTS, 'placed')
    # Now that this has been published once and for all, these join late.
    ready = observer.collect(Bool, f'{node}/ready')
    missing = observer.collect(String, f'{node}/missing')
    poses = {
        name: observer.collect(PoseWithCovarianceStamped, f'{node}/objects/{name}')
        for name in OBJECTS
    }
    offsets = {
        (one, other): observer.collect(Vector3Stamped, f'{node}/offsets/{one}_to_{other}')
        for one, other in combinations(OBJECTS, 2)
    }
    every = [ready, missing, *poses.values(), *offsets.values()]
    observer.wait(lambda: all(every), 'every topic of coffee')
    assert [one.data for one in ready] == [True]
    assert [one.data for one in missing] == ['']

    markers = {marker.name: marker for marker in scene.markers}
    truth = {name: view.of(np.array(marker.position_m)) for name, marker in markers.items()}

    def have_origins() -> bool:
        stamps = {name: pose[-1].header.stamp for name, pose in poses.items()}
        return all(_origin(observer, name, stamp) for name, stamp in stamps.items())

    observer.wait(have_origins, 'what the poses were made of')
    for name, pose in poses.items():
        _check_pose(observer, markers[name], pose[-1], view)
    observer.wait(lambda: _agree(poses, offsets), 'offsets that are those of the poses')
    for (one, other), offset in offsets.items():
        ends = [poses[name][-1] for name in (one, other)]
        covariance = sum(covariance_of(end.pose)[:3, :3] for end in ends)
        error = vector_of(offset[-1].vector) - (truth[other] - truth[one])
        assert error @ np.linalg.solve(covariance, error) < MOST_MAHALANOBIS
    _check_demand(observer, node, ready, missing, view)


def _position(pose: PoseWithCovarianceStamped) -> Floats:
    return vector_of(pose.pose.pose.position)


def _origin(observer: Observer, name: str, stamp: Any) -> tuple[Any, TransformStamped] | None:
    """Return detection and transform of a marker at a time, as far as both were heard."""
    for message, _ in observer.markers:
        if message.child_frame_id == name and message.header.stamp == stamp:
            for transform in observer.transforms:
                if transform.child_frame_id == name and transform.header.stamp == stamp:
                    return message, transform
    return None


def _check_pose(
    observer: Observer, marker: Marker, pose: PoseWithCovarianceStamped, view: View
) -> None:
    """A pose is that of the detection, turned into the view, and true."""
    assert pose.header.frame_id == view.frame
    origin = _origin(observer, marker.name, pose.header.stamp)
    assert origin is not None
    detection, transform = origin
    assert detection.id == marker.id
    assert detection.header.frame_id == transform.header.frame_id == SENSOR_FRAME
    seen = vector_of(detection.pose.pose.position)
    assert np.array_equal(vector_of(transform.transform.translation), seen)
    assert transform.transform.rotation == detection.pose.pose.orientation

    position, covariance = _position(pose), covariance_of(pose.pose)
    truth = view.of(np.array(marker.position_m))
    check_place(position, covariance[:3, :3], truth, view.translation_m)
    if view is not SENSOR_VIEW:
        return  # it is made of all detections so far
    assert np.allclose(position, seen)
    assert np.allclose(covariance, covariance_of(detection.pose))
    # Facing the sensor: the marker's z points away from it.
    away = position - view.translation_m
    axis = matrix_of(quaternion_in(pose.pose.pose.orientation))[:, 2]
    assert np.allclose(axis, away / np.linalg.norm(away))


def _agree(poses: dict[str, list[Any]], offsets: dict[tuple[str, str], list[Any]]) -> bool:
    """Tell whether each offset leads from one pose to the other, as of the later of the two."""
    for pair, offset in offsets.items():
        one, other = (poses[name][-1] for name in pair)
        latest = offset[-1]
        if to_ns(latest.header.stamp) != max(to_ns(end.header.stamp) for end in (one, other)):
            return False
        if latest.header.frame_id != one.header.frame_id:
            return False
        if not np.allclose(vector_of(latest.vector), _position(other) - _position(one)):
            return False
    return True


def _check_demand(
    observer: Observer, node: str, ready: list[Any], missing: list[Any], view: View
) -> None:
    """While more is demanded than a zone can give, what is missing is published with its reason."""
    unsure, stale = 'is known to 0.*; {} m wanted*', 'was last seen ? s ago'
    # The beans are 1 m away, which makes a zone small enough for the first of these.
    steps: list[tuple[str, float, dict[str, str]]] = [
        ('max_stddev', 0.055, dict.fromkeys(OBJECTS[1:], unsure.format(0.055))),
        ('max_stddev', 0.01, dict.fromkeys(OBJECTS, unsure.format(0.01))),
        ('stale_after', 0.1, dict.fromkeys(OBJECTS, stale)),
        ('stale_after', 10.0, dict.fromkeys(OBJECTS, unsure.format(0.01))),
        ('max_stddev', 0.2, {}),
    ]

    def check(parameter: str, number: float, expected: dict[str, str]) -> None:
        missing.clear()
        observer.services.set(f'{observer.namespace}/{node}', **{parameter: number})
        pattern = ', '.join(f'{name} {reason}' for name, reason in expected.items())
        observer.wait(
            lambda: (
                any(fnmatchcase(one.data, pattern) for one in missing)
                and ready[-1].data is not bool(expected)
            ),
            pattern,
        )

    # Landmarks are a bit less sure than single detections.
    for step in steps[view is not SENSOR_VIEW :]:
        check(*step)


def publish_base(observer: Observer) -> None:
    """Publish once and for all how the sensor lies in the frame `base`."""
    pose = to_pose(BASE_VIEW.translation_m, quaternion_of(BASE_VIEW.rotation))
    transform = to_transform(Header(frame_id=BASE_VIEW.frame), SENSOR_FRAME, pose)
    publisher = observer.node.create_publisher(TFMessage, '/tf_static', LATCHED)
    publisher.publish(TFMessage(transforms=[transform]))
