# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Subscribes to detections, and refuses impossible ones: anybody may publish on a topic."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
from rclpy.node import Node

from retrolidar_ros.marker.code import IDS
from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import Marked, covariance_of, quaternion_in, to_ns, vector_of
from retrolidar_ros.nodes.diagnostics import ERROR
from retrolidar_ros.nodes.qos import EVENTS, subscribe

_MAX_NAME = 100
_MAX_AHEAD_S, _MAX_AGE_S = 2.0, 60.0
_MAX_DISTANCE_M = 100.0
_MIN_FORWARD = 0.5  # the field of view is narrower
_MIN_STDDEV, _MAX_STDDEV = 1e-6, 100.0  # of a range or a position [m], and of an angle [rad]
_UNIT = 1e-3
_LOG_PERIOD_S = 5.0


def check_detection(message: Marked, now_ns: int) -> None:
    """Raise ValueError for an impossible detection; after a colon stands its value."""
    frame_id, child = message.header.frame_id, message.child_frame_id
    for field, name in (('frame_id', frame_id), ('child_frame_id', child)):
        if not 0 < len(name) <= _MAX_NAME or not name.isprintable() or name[0] == '/':
            raise ValueError(
                f'{field} is not a TF name of 1 to {_MAX_NAME} characters: {name[:_MAX_NAME]!r}'
            )
    stamp_ns = to_ns(message.header.stamp)
    age_s = (now_ns - stamp_ns) * 1e-9
    position_m, covariance = vector_of(message.pose.pose.position), covariance_of(message.pose)
    distance_m = float(np.linalg.norm(position_m))
    orientation = quaternion_in(message.pose.pose.orientation)
    length = float(np.linalg.norm(orientation))
    largest = float(np.abs(covariance).max())
    # Each comparison is false for NaN.
    for is_possible, reason in (
        (frame_id != child, f'child_frame_id is the frame of the sensor: {child}'),
        (message.id < IDS, f'the ID is not below {IDS}: {message.id}'),
        (
            stamp_ns >= 0 and -_MAX_AHEAD_S <= age_s <= _MAX_AGE_S,
            f'the stamp is far from now (same use_sim_time?): {age_s:.1f} s old',
        ),
        (
            0 < distance_m <= _MAX_DISTANCE_M and position_m[2] >= _MIN_FORWARD * distance_m,
            f'the position is not in front of the sensor: {position_m.tolist()} m',
        ),
        (0 < message.range <= _MAX_DISTANCE_M, f'impossible range: {message.range} m'),
        (
            _MIN_STDDEV <= message.range_stddev <= _MAX_STDDEV,
            f'impossible range_stddev: {message.range_stddev} m',
        ),
        (
            abs(length - 1) <= _UNIT,
            f'the orientation is not a unit quaternion: {orientation.tolist()}',
        ),
        (largest <= _MAX_STDDEV**2, f'the covariance is not finite, or too large: {largest}'),
    ):
        if not is_possible:
            raise ValueError(reason)
    if np.abs(covariance - covariance.T).max() > _UNIT * largest:
        raise ValueError('the covariance is not symmetric')
    smallest = min(np.linalg.eigvalsh(block)[0] for block in (covariance[:3, :3], covariance))
    if not smallest >= _MIN_STDDEV**2:
        raise ValueError(f'the covariance is not positive definite: {smallest}')


class DetectionSubscriber:
    """Passes on valid detections; counts, logs and drops the others."""

    def __init__(
        self,
        node: Node,
        source: str,
        callback: Callable[[Marked], None],
        topics: Sequence[str] = (),
    ) -> None:
        """Subscribe to topics of a source, detections or tracks; by default to its usual one."""
        self._node = node
        self._callback = callback
        self._refused: Counter[str] = Counter()
        self._reason = ''
        self._told = 0
        is_track = source == 'tracks'
        kind, usual = (MarkerTrack, 'tracks') if is_track else (MarkerDetection, 'markers')
        for topic in topics or [usual]:
            subscribe(node, kind, topic, self._on_message, EVENTS)

    def _on_message(self, message: Marked) -> None:
        try:
            check_detection(message, self._node.get_clock().now().nanoseconds)
            self._callback(message)
        except ValueError as error:
            self.refuse(str(error))

    def refuse(self, reason: str) -> None:
        """Count and log an impossible detection; reasons are counted up to their colon."""
        self._refused[reason.partition(':')[0]] += 1
        self._reason = reason
        self._node.get_logger().error(
            f'detection refused: {reason}', throttle_duration_sec=_LOG_PERIOD_S
        )

    def examine(self, values: dict[str, str]) -> list[tuple[bytes, str]]:
        """Add the counts to diagnostics; return the problems since the last call."""
        for reason, count in self._refused.items():
            values[f'refused: {reason}'] = str(count)
        total = sum(self._refused.values())
        new, self._told = total - self._told, total
        return [(ERROR, f'{new} detections refused: {self._reason}')] if new else []
