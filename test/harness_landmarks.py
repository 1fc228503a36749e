# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What is asserted of the node `landmarks`, however it was started."""

from __future__ import annotations

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import PoseWithCovarianceStamped, TransformStamped
from harness_use_cases import RELIABLE, Collected, Health, wait
from std_srvs.srv import Trigger
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import Marker, MarkerArray

from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.place import place, zone_bearing
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_detection_msg, to_ns, to_time
from retrolidar_ros.nodes.listener import Listener
from retrolidar_ros.sensor.frame import Floats, ZoneGrid
from retrolidar_ros.settings.yaml_files import load_yaml

HAND = 'hand_optical_frame'
FIXED = 'base_link'
GROUND, EDGE_M = 'ground', 0.4
MUG_M = np.array([0.1, -0.05, 1.2])
CORNERS = ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))
_GRID = ZoneGrid()
_RANGE_STDDEV_M = 0.001
_MOST_MAHALANOBIS = 16.27
_LATE_S = 0.25


class Hand:
    """Says where it is on /tf, and what it reads of markers on /NAMESPACE/markers."""

    def __init__(self, listener: Listener, namespace: str) -> None:
        self._listener = listener
        node = listener.node
        self._markers = node.create_publisher(MarkerDetection, f'{namespace}/markers', 100)
        self._transforms = node.create_publisher(TFMessage, '/tf', 100)

    def wait_for_subscribers(self) -> None:
        wait(
            self._listener,
            lambda: (
                self._markers.get_subscription_count() > 0
                and self._transforms.get_subscription_count() > 1
            ),
            lambda: 'subscribers',
        )

    def move(self, at_m: Floats, stamp_ns: int) -> None:
        transform = TransformStamped(child_frame_id=HAND)
        transform.header.frame_id, transform.header.stamp = FIXED, to_time(stamp_ns)
        way = transform.transform.translation
        way.x, way.y, way.z = at_m.tolist()
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
        detection = Detection(
            id=identity,
            stamp_ns=stamp_ns,
            start_ns=stamp_ns,
            end_ns=stamp_ns,
            place=place(zone_bearing(zone, _GRID), range_m, _RANGE_STDDEV_M),
            snr_db=20.0,
            evidence=50.0,
            decision_margin=20.0,
            bit_period_s=0.042,
            score=0.9,
            likelihood=1.0,
            corrected_bits=0,
            packets=1,
            zones=(zone,),
        )
        if late_s:
            self._markers.publish(to_detection_msg(detection, HAND, name))
            self._listener.spin_until(lambda: False, late_s)
        self.move(at_m, stamp_ns - 1_000_000)
        self.move(at_m, stamp_ns + 1_000_000)
        if not late_s:
            self._markers.publish(to_detection_msg(detection, HAND, name))
        self._listener.spin_until(lambda: False, 0.01)  # the hand was there, and there only
        return stamp_ns


def _squared(message: PoseWithCovarianceStamped, truth_m: Floats) -> float:
    place_ = message.pose.pose.position
    off = np.array([place_.x, place_.y, place_.z]) - truth_m
    covariance = np.array(message.pose.covariance).reshape(6, 6)[:3, :3]
    return float(off @ np.linalg.solve(covariance, off))


def _call(listener: Listener, service: str) -> Any:
    client = listener.node.create_client(Trigger, service)
    wait(listener, client.service_is_ready, lambda: service)
    future: Any = client.call_async(Trigger.Request())
    wait(listener, future.done, lambda: f'an answer of {service}')
    return future.result()


def check_landmarks(listener: Listener, namespace: str, saved: Path) -> None:
    """A hand that looks from four places finds the mug, and where it is carried to."""
    node = f'{namespace}/landmarks'
    health = Health(listener, f'{node}: landmarks')
    mug = Collected(listener, PoseWithCovarianceStamped, f'{node}/objects/mug')
    shapes = Collected(listener, MarkerArray, f'{node}/marker_array')
    hand = Hand(listener, namespace)
    hand.wait_for_subscribers()
    health.wait_for(DiagnosticStatus.WARN, 'nothing is placed yet')
    corners = [np.append(corner, 0.0) for corner in CORNERS]
    # The topic is made with the first pose; until that is heard, messages may get lost.
    while not mug.messages:
        hand.read('mug', 2107, MUG_M, corners[0])
        listener.spin_until(lambda: bool(mug.messages), 0.5)
    delays_s = (_LATE_S, 0.0, 0.0, 0.0, 0.0, 0.0)
    read_ns = {
        hand.read('mug', 2107, MUG_M, at_m, late_s)
        for at_m, late_s in zip(2 * corners[1:], delays_s, strict=True)
    }

    def without_pose() -> set[int]:
        placed_ns = [to_ns(one.header.stamp) for one in mug.messages]
        return {one for one in read_ns if not any(abs(one - ns) < 1000 for ns in placed_ns)}

    wait(listener, lambda: not without_pose(), lambda: f'poses of {without_pose()}')
    last = mug.messages[-1]
    assert last.header.frame_id == FIXED
    assert all(_squared(one, MUG_M) < _MOST_MAHALANOBIS for one in mug.messages)
    covariance = np.array(last.pose.covariance).reshape(6, 6)
    assert np.sqrt(np.linalg.eigvalsh(covariance[:3, :3])[-1]) < 0.03
    assert np.diag(covariance)[3:].min() > 1  # one marker has no orientation

    def transforms() -> list[TransformStamped]:
        return [one for one in listener.transforms if one.child_frame_id == 'landmark_mug']

    wait(listener, lambda: bool(transforms()), lambda: 'the frame of the mug')
    assert {one.header.frame_id for one in transforms()} == {FIXED}
    wait(listener, lambda: bool(shapes.messages), lambda: 'shapes')
    kinds = [one.type for one in shapes.messages[-1].markers if one.action == Marker.ADD]
    assert kinds == [Marker.SPHERE, Marker.TEXT_VIEW_FACING]

    values = health.wait_for(DiagnosticStatus.OK, '1 placed')
    assert float(values['mug: baseline [m]']) > 0.5
    answer = _call(listener, f'{node}/save')
    assert answer.success, answer.message
    content = load_yaml(saved)
    assert content['frame'] == FIXED
    assert set(content['landmarks']) == {'mug'}

    there_m = MUG_M + np.array([0.25, 0.1, 0.2])
    mug.clear()
    for at_m in corners[:2]:
        hand.read('mug', 2107, there_m, at_m)
    wait(
        listener,
        lambda: bool(mug.messages) and _squared(mug.messages[-1], there_m) < _MOST_MAHALANOBIS,
        lambda: 'the mug at its new place',
    )
    for one in mug.messages:
        assert min(_squared(one, MUG_M), _squared(one, there_m)) < _MOST_MAHALANOBIS
    assert _call(listener, f'{node}/forget').success
    health.wait_for(DiagnosticStatus.WARN, 'nothing is placed yet')


def check_drone(listener: Listener, namespace: str, at: Callable[[int], Floats]) -> None:
    """Three sensors on the ground tell where a drone is, across their lines of sight, too.

    Parameters
    ----------
    listener : Listener
    namespace : str
    at : callable
        Returns where it is at a stamp [ns], shape (3,) [m].
    """
    poses = Collected(
        listener, PoseWithCovarianceStamped, f'{namespace}/landmarks/objects/drone', RELIABLE
    )
    health = Health(listener, f'{namespace}/landmarks: landmarks')
    wait(listener, lambda: len(poses.messages) >= 12, lambda: f'12, not {len(poses.messages)}')
    frames = {message.header.frame_id for message, _ in listener.markers}
    assert frames == {f'sensor{index}_optical_frame' for index in range(3)}
    for pose in poses.messages[-6:]:
        assert pose.header.frame_id == GROUND
        assert _squared(pose, at(to_ns(pose.header.stamp))) < _MOST_MAHALANOBIS
        covariance = np.array(pose.pose.covariance).reshape(6, 6)[:3, :3]
        assert np.sqrt(np.linalg.eigvalsh(covariance)[-1]) < 0.04
    values = health.wait_for(DiagnosticStatus.OK, '1 placed')
    assert float(values['drone: baseline [m]']) == pytest.approx(EDGE_M, abs=1e-3)
