# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detections as readings in a fixed frame, once TF knows the sensors' poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import covariance_of, vector_of
from retrolidar_ros.nodes.detection_subscriber import DetectionSubscriber
from retrolidar_ros.nodes.diagnostics import WARN
from retrolidar_ros.nodes.run import repeat
from retrolidar_ros.nodes.transforms import TransformFinder
from retrolidar_ros.tasks.reading import Reading, SensorPose, reading

_TICK_S = 0.1
_MAX_WAITING = 1000
_JUMP = Duration(seconds=1.0)  # more is a clock that was set, or a replay that restarted


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
        """Begin again if time has jumped back."""
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
            throttle_duration_sec=5.0,
        )
