# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is asserted of the node `landmarks`, however it was started."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from harness import MAX_MAHALANOBIS
from harness_observer import Observer, values_of
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from retrolidar_ros.detector.place import place, zone_bearing
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import (
    covariance_of,
    to_header,
    to_ns,
    to_pose,
    to_transform,
    vector_of,
)
from retrolidar_ros.sensor.frame import Floats, ZoneGrid
from retrolidar_ros.settings.yaml_files import load_yaml

HAND = 'hand_optical_frame'
FIXED = 'base_link'
MUG_M = np.array([0.1, -0.05, 1.2])
CORNERS = ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))
_GRID = ZoneGrid()
_RANGE_STDDEV_M = 0.001
_LATE_S = 0.25


class Hand:
    """Says where it is on /tf, and what it reads of markers on /NAMESPACE/markers."""

    def __init__(self, observer: Observer) -> None:
        """Wait for subscribers."""
        self._observer = observer
        self._markers = observer.node.create_publisher(MarkerDetection, 'markers', 100)
        self._transforms = observer.node.create_publisher(TFMessage, '/tf', 100)
        observer.wait(
            lambda: (
                self._markers.get_subscription_count() > 1
                and self._transforms.get_subscription_count() > 1
            ),
            'subscribers',
        )

    def move(self, at_m: Floats, stamp_ns: int) -> None:
        pose = to_pose(at_m, np.array([0.0, 0.0, 0.0, 1.0]))
        transform = to_transform(to_header(stamp_ns, FIXED), HAND, pose)
        self._transforms.publish(TFMessage(transforms=[transform]))

    def read(
        self, name: str, identity: int, there_m: Floats, at_m: Floats, late_s: float = 0.0
    ) -> int:
        """Read a marker from a place; TF follows so much later; return the stamp [ns]."""
        own = there_m - at_m
        column, row = np.rint(own[:2] / own[2] / _GRID.pitch + 1.5).astype(int)
        zone = int(4 * row + column)
        range_m = float(np.linalg.norm(own))
        stamp_ns = time.time_ns()
        spot = place(zone_bearing(zone, _GRID), range_m, _RANGE_STDDEV_M)
        message = MarkerDetection(header=to_header(stamp_ns, HAND), child_frame_id=name)
        message.id, message.range, message.range_stddev = identity, range_m, _RANGE_STDDEV_M
        message.pose.pose = to_pose(spot.position_m, spot.orientation)
        message.pose.covariance = spot.covariance.ravel()
        if late_s:
            self._markers.publish(message)
            self._observer.pass_time(late_s)
        self.move(at_m, stamp_ns - 1_000_000)
        self.move(at_m, stamp_ns + 1_000_000)
        if not late_s:
            self._markers.publish(message)
        self._observer.pass_time(0.01)  # the hand was there, and there only
        return stamp_ns


def squared(message: PoseWithCovarianceStamped, truth_m: Floats) -> float:
    """Return the squared distance from the truth, in deviations."""
    off = vector_of(message.pose.pose.position) - truth_m
    return float(off @ np.linalg.solve(covariance_of(message.pose)[:3, :3], off))


def deviation_m(message: PoseWithCovarianceStamped) -> float:
    """Return the deviation of a position in its worst direction [m]."""
    return float(np.sqrt(np.linalg.eigvalsh(covariance_of(message.pose)[:3, :3])[-1]))


def check_landmarks(observer: Observer, saved: Path) -> None:
    """A hand that looks from four places finds the mug, and where it is carried to."""
    name = 'landmarks: landmarks'
    mug = observer.collect(PoseWithCovarianceStamped, 'landmarks/objects/mug')
    shapes = observer.collect(MarkerArray, 'landmarks/marker_array')
    hand = Hand(observer)
    observer.wait_for_status(name, DiagnosticStatus.WARN, 'nothing is placed yet')
    corners = [np.append(corner, 0.0) for corner in CORNERS]
    # The topic is made with the first pose; until it is discovered, messages may get lost.
    while not mug:
        hand.read('mug', 2107, MUG_M, corners[0])
        observer.spin_until(lambda: bool(mug), 0.5)
    delays_s = (_LATE_S, 0.0, 0.0, 0.0, 0.0, 0.0)
    read_ns = [
        hand.read('mug', 2107, MUG_M, at_m, late_s)
        for at_m, late_s in zip(2 * corners[1:], delays_s, strict=True)
    ]

    def has_all() -> bool:
        """Return whether the newest pose is of the last reading and as exact as all together.

        On a busy machine several readings share a pose, and those that wait for their transform
        come after the last one.
        """
        newest = abs(to_ns(mug[-1].header.stamp) - read_ns[-1]) < 1000
        return newest and deviation_m(mug[-1]) < 0.03

    observer.wait(has_all, 'a pose of all readings')
    last = mug[-1]
    assert last.header.frame_id == FIXED
    assert all(squared(one, MUG_M) < MAX_MAHALANOBIS for one in mug)
    assert np.diag(covariance_of(last.pose))[3:].min() > 1  # one marker has no orientation

    def transforms() -> list[TransformStamped]:
        return [one for one in observer.transforms if one.child_frame_id == 'landmark_mug']

    observer.wait(lambda: bool(transforms()), 'the frame of the mug')
    assert {one.header.frame_id for one in transforms()} == {FIXED}
    observer.wait(lambda: bool(shapes), 'shapes')
    kinds = [one.type for one in shapes[-1].markers if one.action == Marker.ADD]
    assert kinds == [Marker.SPHERE, Marker.TEXT_VIEW_FACING]

    values = values_of(observer.wait_for_status(name, DiagnosticStatus.OK, '1 placed'))
    assert float(values['mug: baseline [m]']) > 0.5
    assert int(values['mug: readings']) > len(read_ns)
    answer = observer.services.trigger('landmarks/save')
    assert answer.success, answer.message
    content = load_yaml(saved)
    assert content['frame'] == FIXED
    assert set(content['landmarks']) == {'mug'}
    assert '1 landmarks' in answer.message
    assert str(saved) in answer.message

    there_m = MUG_M + np.array([0.25, 0.1, 0.2])
    mug.clear()
    for at_m in corners[:3]:
        hand.read('mug', 2107, there_m, at_m)
    observer.wait(
        lambda: bool(mug) and squared(mug[-1], there_m) < MAX_MAHALANOBIS,
        'the mug at its new place',
    )
    for one in mug:
        assert min(squared(one, MUG_M), squared(one, there_m)) < MAX_MAHALANOBIS
    assert observer.services.trigger('landmarks/forget').success
    answer = observer.services.trigger('landmarks/save')
    assert not answer.success
    assert 'nothing is placed' in answer.message
    assert load_yaml(saved) == content
    observer.wait_for_status(name, DiagnosticStatus.WARN, 'nothing is placed yet')
