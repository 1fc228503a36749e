# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Subscribes to detections, refuses impossible ones, and makes readings of them by TF."""

from collections import Counter, deque
from collections.abc import Callable, Sequence

import numpy as np
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from retrolidar_ros.marker.code import IDS
from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import Marked, covariance_of, quaternion_in, to_ns, vector_of
from retrolidar_ros.nodes.diagnostics import ERROR, WARN
from retrolidar_ros.nodes.qos import EVENTS, subscribe
from retrolidar_ros.nodes.run import repeat
from retrolidar_ros.nodes.transforms import TransformFinder
from retrolidar_ros.tasks.reading import Reading, SensorPose, reading

_MAX_NAME = 100
_MAX_AHEAD_S, _MAX_AGE_S = 2.0, 60.0
_MAX_DISTANCE_M = 100.0
_MIN_FORWARD = 0.5  # the field of view is narrower
_MIN_STDDEV, _MAX_STDDEV = 1e-6, 100.0  # of a range or a position [m], and of an angle [rad]
_UNIT = 1e-3
_LOG_PERIOD_S = 5.0
_TICK_S = 0.1
_MAX_WAITING = 1000
_JUMP = Duration(seconds=1.0)  # more is a clock that was set, or a replay that restarted


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
    smallest = np.linalg.eigvalsh(covariance)[0]
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


class TransformedDetections(DetectionSubscriber):
    """Makes readings of detections when the transforms of their time have come."""

    def __init__(
        self,
        node: Node,
        fixed_frame: str,
        patience_s: float,
        on_reading: Callable[[Reading, MarkerDetection], None],
        restart: Callable[[], None],
        topics: Sequence[str] = (),
    ) -> None:
        """Subscribe to topics of detections, by default to `markers`.

        `on_reading` gets each reading, and its detection, if its transform comes within
        `patience_s` [s], and may refuse it by a ValueError; `restart` is called when time jumps
        back.
        """
        super().__init__(node, 'detections', self._on_detection, topics)
        self.finder = TransformFinder(node)
        self._fixed = fixed_frame
        self._patience_s = patience_s
        self._on_reading = on_reading
        self._restart = restart
        self._ticked = node.get_clock().now()
        self._waiting: deque[tuple[MarkerDetection, Time]] = deque()
        self._dropped = self._dropped_before = 0
        self._missing = ''
        repeat(node, _TICK_S, self._tick)

    def examine(self, values: dict[str, str]) -> list[tuple[bytes, str]]:
        """Add counts to diagnostics; return the problems since the last call."""
        values['waiting for a transform'] = str(len(self._waiting))
        values['dropped without a transform'] = str(self._dropped)
        problems = super().examine(values)
        new, self._dropped_before = self._dropped - self._dropped_before, self._dropped
        if new:
            problems.append((WARN, f'{new} detections dropped: {self._missing}'))
        return problems

    def _on_detection(self, message: MarkerDetection) -> None:
        self._check_clock()
        if self._transform(message):
            return
        self._waiting.append((message, self._ticked))
        if len(self._waiting) > _MAX_WAITING:
            self._drop(self._waiting.popleft()[0])

    def _check_clock(self) -> None:
        now = self._node.get_clock().now()
        if now + _JUMP < self._ticked:
            self.finder.forget()
            self._waiting.clear()
            self._restart()
        self._ticked = now

    def _tick(self) -> None:
        """Pass on waiting detections whose transforms are known by now."""
        self._check_clock()
        for _ in range(len(self._waiting)):
            message, came = self._waiting.popleft()
            if self._transform(message):
                continue
            if (self._ticked - came).nanoseconds * 1e-9 < self._patience_s:
                self._waiting.append((message, came))
            else:
                self._drop(message)

    def _transform(self, message: MarkerDetection) -> bool:
        """Pass a detection on; return False if its transform is not known yet."""
        sensor, stamp = message.header.frame_id, Time.from_msg(message.header.stamp)
        found = self.finder.find(self._fixed, sensor, stamp)
        if found is None:
            return False
        try:
            placed = reading(
                message.id,
                sensor,
                stamp.nanoseconds * 1e-9,
                message.range,
                message.range_stddev,
                vector_of(message.pose.pose.position),
                covariance_of(message.pose)[:3, :3],
                SensorPose(*found),
            )
            self._on_reading(placed, message)
        except ValueError as error:
            self.refuse(str(error))
        return True

    def _drop(self, message: MarkerDetection) -> None:
        self._dropped += 1
        self._missing = f'no transform from {message.header.frame_id} to {self._fixed}'
        self._node.get_logger().warning(
            f'{self._missing}; a reading of {message.child_frame_id} is left out',
            throttle_duration_sec=_LOG_PERIOD_S,
        )
