# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detections as readings in a fixed frame, as soon as TF knows where their sensors were."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.time import Time

from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import covariance_of, to_ns, vector_of
from retrolidar_ros.nodes.qos import EVENTS, subscribe
from retrolidar_ros.nodes.transforms import TransformFinder
from retrolidar_ros.tasks.reading import Reading, SensorPose, reading

_TICK_S = 0.1
_MOST_WAITING = 1000
# Errors of a track are alike for about so long; a marker slower than this is at rest.
_ALIKE_S = 1.0
_REST_M_S = 0.02


class PlacedReadings:
    """Subscribes to detections, and waits for the transforms of their time."""

    def __init__(
        self,
        node: Node,
        topics: Sequence[str],
        source: str,
        fixed_frame: str,
        patience_s: float,
        take: Callable[[Reading, MarkerDetection | MarkerTrack], None],
        forget: Callable[[], None],
    ) -> None:
        """Subscribe to topics of a source, detections or tracks.

        `take` gets each reading, and its detection, if its transform comes within `patience_s` [s];
        `forget` is called when time jumps back, as in a replay.
        """
        self.dropped: Counter[str] = Counter()
        """Detections that could not be placed, by reason."""
        self.finder = TransformFinder(node)
        self._node = node
        self._fixed = fixed_frame
        self._patience_s = patience_s
        self._hand_on = take
        self._forget = forget
        self._ticked = node.get_clock().now()
        self._waiting: deque[tuple[MarkerDetection | MarkerTrack, Time]] = deque(
            maxlen=_MOST_WAITING
        )
        self._taken_ns: dict[tuple[str, str], int] = {}
        for topic in topics:
            if source == 'tracks':
                subscribe(node, MarkerTrack, topic, self._take_track, EVENTS)
            else:
                subscribe(node, MarkerDetection, topic, self._take, EVENTS)
        node.create_timer(_TICK_S, self.tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _take_track(self, message: MarkerTrack) -> None:
        """Take a marker at rest once for so long as errors of its track are alike."""
        key = (message.header.frame_id, message.child_frame_id)
        stamp_ns = to_ns(message.header.stamp)
        age_s = 1e-9 * abs(stamp_ns - self._taken_ns.get(key, to_ns(message.first)))
        if age_s >= _ALIKE_S and np.linalg.norm(vector_of(message.twist.twist.linear)) < _REST_M_S:
            self._taken_ns[key] = stamp_ns
            self._take(message)

    def _take(self, message: MarkerDetection | MarkerTrack) -> None:
        if to_ns(message.header.stamp) >= 0:
            self._waiting.append((message, self._node.get_clock().now()))
            self.tick()

    def tick(self) -> None:
        """Hand on waiting detections whose transforms are known."""
        now = self._node.get_clock().now()
        if now < self._ticked:
            self.finder.forget()
            self._waiting.clear()
            self._forget()
        self._ticked = now
        for _ in range(len(self._waiting)):
            message, came = self._waiting.popleft()
            if self._place(message):
                continue
            if (now - came).nanoseconds * 1e-9 < self._patience_s:
                self._waiting.append((message, came))
            else:
                self._drop(f'no transform from {message.header.frame_id} to {self._fixed}', message)

    def _place(self, message: MarkerDetection | MarkerTrack) -> bool:
        """Hand a detection on; return False if its transform is not known yet."""
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
        except ValueError as error:
            self._drop(str(error), message)
            return True
        self._hand_on(placed, message)
        return True

    def _drop(self, reason: str, message: MarkerDetection | MarkerTrack) -> None:
        self.dropped[reason.partition(':')[0]] += 1
        self._node.get_logger().warning(
            f'{reason}; a reading of {message.child_frame_id} is left out',
            throttle_duration_sec=5.0,
        )
