# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is asserted of the task coffee, however its nodes were started; and a hand that reads."""

import time
from fnmatch import fnmatchcase
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from harness import MAX_MAHALANOBIS, check_place
from harness_observer import LATCHED, Observer, values_of
from harness_readings import FORWARD, GRID, SQUARE
from std_msgs.msg import Bool, Header, String
from tf2_msgs.msg import TFMessage

from retrolidar_ros.detector.detection import largest_stddev, place, zone_bearing
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import (
    covariance_of,
    from_pose,
    to_header,
    to_ns,
    to_pose,
    to_transform,
    vector_of,
)
from retrolidar_ros.scene.description import Marker, Scene
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import quaternion_of

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
        return self.rotation @ position_m + self.translation_m


SENSOR_VIEW = View(SENSOR_FRAME, np.eye(3), np.zeros(3))
BASE_VIEW = View('base', FORWARD, np.array([0.25, -0.1, 0.8]))


def check_coffee(observer: Observer, scene: Scene, node: str, view: View) -> None:
    """All objects are found; subscribers that join later get that, and where they are."""
    status = observer.wait_for_status(f'{node}: objects', DiagnosticStatus.OK, '3 objects placed')
    assert dict.fromkeys(OBJECTS, 'placed').items() <= values_of(status).items()
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
        assert error @ np.linalg.solve(covariance, error) < MAX_MAHALANOBIS
    _check_demand(observer, node, ready, missing)


def _position(pose: PoseWithCovarianceStamped) -> Floats:
    return vector_of(pose.pose.pose.position)


def _origin(observer: Observer, name: str, stamp: Any) -> MarkerDetection | None:
    """Return the detection of a marker at a time, if it has come."""
    detections = (message for message, _ in observer.markers)
    ours = (one for one in detections if (one.child_frame_id, one.header.stamp) == (name, stamp))
    return next(ours, None)


def _check_pose(
    observer: Observer, marker: Marker, pose: PoseWithCovarianceStamped, view: View
) -> None:
    """A pose is that of the detection, turned into the view, and true."""
    assert pose.header.frame_id == view.frame
    detection = _origin(observer, marker.name, pose.header.stamp)
    assert detection is not None
    assert (detection.id, detection.header.frame_id) == (marker.id, SENSOR_FRAME)
    position, covariance = _position(pose), covariance_of(pose.pose)
    truth = view.of(np.array(marker.position_m))
    check_place(position, covariance[:3, :3], truth, view.translation_m)
    if view is not SENSOR_VIEW:
        return  # it is made of all detections so far
    assert np.allclose(position, vector_of(detection.pose.pose.position))
    assert np.allclose(covariance, covariance_of(detection.pose))
    # Facing the sensor: the marker's z points away from it.
    away = position - view.translation_m
    axis = from_pose(pose.pose.pose)[1][:, 2]
    assert np.allclose(axis, away / np.linalg.norm(away))


def _agree(poses: dict[str, list[Any]], offsets: dict[tuple[str, str], list[Any]]) -> bool:
    """Tell whether each offset leads from one pose to the other, as of the later of the two."""
    for pair, offset in offsets.items():
        one, other = (poses[name][-1] for name in pair)
        latest = offset[-1]
        is_last = to_ns(latest.header.stamp) == max(to_ns(end.header.stamp) for end in (one, other))
        is_there = np.allclose(vector_of(latest.vector), _position(other) - _position(one))
        if not (is_last and is_there and latest.header.frame_id == one.header.frame_id):
            return False
    return True


def _check_demand(observer: Observer, node: str, ready: list[Any], missing: list[Any]) -> None:
    """While more is demanded than a zone can give, what is missing is published with its reason."""
    reason = '±* mm (±10 mm needed*'
    demanded = ', '.join(f'{name} {reason}' for name in OBJECTS)
    for max_stddev, pattern in ((0.01, demanded), (0.2, '')):
        missing.clear()
        observer.services.set(f'{observer.namespace}/{node}', max_stddev=max_stddev)
        observer.wait(
            lambda wanted=pattern: any(fnmatchcase(one.data, wanted) for one in missing),  # type: ignore[misc]
            pattern,
        )
        observer.wait(lambda wanted=pattern: ready[-1].data is not bool(wanted), 'ready')  # type: ignore[misc]


def publish_base(observer: Observer) -> None:
    """Publish once and for all how the sensor lies in the frame `base`."""
    pose = to_pose(BASE_VIEW.translation_m, quaternion_of(BASE_VIEW.rotation))
    transform = to_transform(Header(frame_id=BASE_VIEW.frame), SENSOR_FRAME, pose)
    publisher = observer.node.create_publisher(TFMessage, '/tf_static', LATCHED)
    publisher.publish(TFMessage(transforms=[transform]))


HAND = 'hand_optical_frame'
FIXED = 'base_link'
_RANGE_STDDEV_M = 0.001


def detection_of(name: str, identity: int, own_m: Floats, stamp_ns: int) -> MarkerDetection:
    """Return what the hand reads of a marker at a place of its own frame."""
    column, row = np.rint(own_m[:2] / own_m[2] / GRID.pitch + 1.5).astype(int)
    range_m = float(np.linalg.norm(own_m))
    spot = place(zone_bearing(int(4 * row + column), GRID), range_m, _RANGE_STDDEV_M)
    message = MarkerDetection(header=to_header(stamp_ns, HAND), child_frame_id=name)
    message.id, message.range, message.range_stddev = identity, range_m, _RANGE_STDDEV_M
    message.pose.pose = to_pose(spot.position_m, spot.orientation)
    message.pose.covariance = spot.covariance.ravel()
    return message


class Hand:
    """Says where it is on /tf, and what it reads of markers on /NAMESPACE/markers."""

    def __init__(self, observer: Observer) -> None:
        """Wait for subscribers."""
        self._observer = observer
        self._markers = observer.node.create_publisher(MarkerDetection, 'markers', 100)
        self._transforms = observer.node.create_publisher(TFMessage, '/tf', 100)
        for publisher in (self._markers, self._transforms):
            observer.wait(lambda one=publisher: one.get_subscription_count() > 1, 'subscribers')  # type: ignore[misc]

    def move(self, at_m: Floats, stamp_ns: int) -> None:
        pose = to_pose(at_m, np.array([0.0, 0.0, 0.0, 1.0]))
        transform = to_transform(to_header(stamp_ns, FIXED), HAND, pose)
        self._transforms.publish(TFMessage(transforms=[transform]))

    def read(
        self, name: str, identity: int, there_m: Floats, at_m: Floats, late_s: float = 0.0
    ) -> int:
        """Read a marker from a place; TF follows so much later; return the stamp [ns]."""
        stamp_ns = time.time_ns()
        message = detection_of(name, identity, there_m - at_m, stamp_ns)
        if late_s:
            self._markers.publish(message)
            self._observer.pass_time(late_s)
        self.move(at_m, stamp_ns - 1_000_000)
        self.move(at_m, stamp_ns + 1_000_000)
        if not late_s:
            self._markers.publish(message)
        self._observer.pass_time(0.01)  # the hand was there, and there only
        return stamp_ns

    def show(self, name: str, identity: int, there_m: Floats, came: list[Any]) -> None:
        """Read a marker from four places, again and again until a message has come."""

        def has_come() -> bool:
            for at_m in SQUARE:
                self.read(name, identity, there_m, at_m)
            return bool(came)

        self._observer.wait(has_come, f'a message of {name}')


def squared(message: PoseWithCovarianceStamped, truth_m: Floats) -> float:
    """Return the squared distance from the truth, in deviations."""
    off = vector_of(message.pose.pose.position) - truth_m
    return float(off @ np.linalg.solve(covariance_of(message.pose)[:3, :3], off))


def deviation_m(message: PoseWithCovarianceStamped) -> float:
    """Return the deviation of a position in its worst direction [m]."""
    return largest_stddev(covariance_of(message.pose)[:3, :3])
