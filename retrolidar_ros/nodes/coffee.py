# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `coffee` node: waits until all objects of a task are placed, and says where (paper §7.1)."""

from __future__ import annotations

import re
from collections import deque
from typing import NamedTuple

import numpy as np
from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Bool, Header, String

from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import to_ns
from retrolidar_ros.nodes.diagnostics import OK, WARN, Health, publish_health
from retrolidar_ros.nodes.names import topic_part
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.qos import EVENTS, LATCHED, OVERRIDABLE
from retrolidar_ros.nodes.run import run
from retrolidar_ros.nodes.transforms import TransformFinder
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import matrix_of, product
from retrolidar_ros.tasks.objects import ObjectBoard

_TICK_S = 0.1
# How long a detection waits for the transform of its time.
_PATIENCE_S = 1.0


class _Pose(NamedTuple):
    position_m: Floats
    orientation: Floats
    """Quaternion (x, y, z, w)."""
    covariance: Floats
    """Shape (6, 6)."""


class CoffeeNode(Node):
    """Publishes poses and offsets of named objects, and whether all of them are placed."""

    def __init__(self) -> None:
        """Declare parameters and subscribe."""
        super().__init__('coffee')
        parameters = Parameters(self, 'coffee')
        parameters.texts('objects', 'TF frames of the markers on the objects.')
        parameters.text('target_frame', "Frame of the poses; empty = the sensor's.")
        parameters.number(
            'max_stddev',
            'How uncertain a position may be, along any axis [m].',
            1e-4,
            10.0,
            live=True,
        )
        parameters.number(
            'stale_after', 'How long a detection counts [s].', 0.1, 86400.0, live=True
        )
        values = parameters.values
        self._board = ObjectBoard(values['objects'], values['max_stddev'], values['stale_after'])
        parameters.follow(self._change)
        self._target = values['target_frame']
        self._finder = TransformFinder(self) if self._target else None
        self._ticked = self.get_clock().now()
        self._waiting: deque[tuple[MarkerDetection, Time]] = deque()
        self._told: dict[str, str] | None = None
        self._ready = self.create_publisher(Bool, '~/ready', LATCHED)
        self._missing = self.create_publisher(String, '~/missing', LATCHED)
        self._poses = {
            name: self.create_publisher(
                PoseWithCovarianceStamped, f'~/objects/{topic_part(name)}', LATCHED
            )
            for name in self._board.names
        }
        self._offsets = {
            (one, other): self.create_publisher(
                Vector3Stamped, f'~/offsets/{topic_part(one)}_to_{topic_part(other)}', LATCHED
            )
            for index, one in enumerate(self._board.names)
            for other in self._board.names[index + 1 :]
        }
        publish_health(self, 'objects', '', self._examine)
        self.create_subscription(
            MarkerDetection, 'markers', self._take, EVENTS, qos_overriding_options=OVERRIDABLE
        )
        parameters.warn_of_unknown()
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _change(self, values: dict[str, float]) -> None:
        self._board.max_stddev_m = values['max_stddev']
        self._board.stale_after_s = values['stale_after']

    def _take(self, message: MarkerDetection) -> None:
        if message.child_frame_id in self._poses and to_ns(message.header.stamp) >= 0:
            self._waiting.append((message, self.get_clock().now()))
            self._tick()

    def _tick(self) -> None:
        """Place what waits, as far as its transforms are known, and say what is missing."""
        now = self.get_clock().now()
        if now < self._ticked and self._finder is not None:
            self._finder.forget()
        self._ticked = now
        for _ in range(len(self._waiting)):
            message, came = self._waiting.popleft()
            if not self._place(message):
                if (now - came).nanoseconds * 1e-9 < _PATIENCE_S:
                    self._waiting.append((message, came))
                else:
                    self.get_logger().warning(
                        f'no transform from {message.header.frame_id} to {self._target} for '
                        f'{message.child_frame_id}; it is left out',
                        throttle_duration_sec=5.0,
                    )
        self._tell(self._board.missing(now.nanoseconds))

    def _place(self, message: MarkerDetection) -> bool:
        """Publish where an object is; return whether that could be told."""
        pose = _pose_of(message)
        header = Header(stamp=message.header.stamp, frame_id=message.header.frame_id)
        if self._finder is not None and self._target != header.frame_id:
            found = self._finder.find(
                self._target, header.frame_id, Time.from_msg(message.header.stamp)
            )
            if found is None:
                return False
            pose = _moved(pose, *found)
            header.frame_id = self._target
        name = message.child_frame_id
        stamp_ns, now_ns = to_ns(header.stamp), self.get_clock().now().nanoseconds
        position_m, covariance = pose.position_m, pose.covariance[:3, :3]
        if not self._board.see(name, stamp_ns, header.frame_id, position_m, covariance):
            return True
        self._poses[name].publish(_message(header, pose))
        for (one, other), offset in self._board.offsets(now_ns).items():
            if name in (one, other):
                way = Vector3Stamped(header=header)
                way.vector.x, way.vector.y, way.vector.z = offset.tolist()
                self._offsets[one, other].publish(way)
        return True

    def _tell(self, missing: dict[str, str]) -> None:
        """Publish and log what is missing, and why, whenever more than a number has changed."""
        told = {name: re.sub(r'[\d.]+', '', reason) for name, reason in missing.items()}
        if self._told == told:
            return
        self._told = told
        text = ', '.join(f'{name} {reason}' for name, reason in missing.items())
        self._missing.publish(String(data=text))
        self._ready.publish(Bool(data=not missing))
        self.get_logger().info(f'waiting: {text}' if missing else 'all objects are placed')

    def _examine(self) -> Health:
        missing = self._board.missing(self.get_clock().now().nanoseconds)
        values = {name: missing.get(name, 'placed') for name in self._board.names}
        if missing:
            return Health(WARN, f'{len(missing)} of {len(values)} objects missing', values)
        return Health(OK, f'{len(values)} objects placed', values)


def _pose_of(message: MarkerDetection) -> _Pose:
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    return _Pose(
        np.array([place.x, place.y, place.z]),
        np.array([turn.x, turn.y, turn.z, turn.w]),
        np.array(message.pose.covariance).reshape(6, 6),
    )


def _moved(pose: _Pose, rotation: Floats, translation: Floats) -> _Pose:
    """Return a pose in a frame to which `rotation` and `translation` lead."""
    matrix = matrix_of(rotation)
    turning = np.kron(np.eye(2), matrix)
    return _Pose(
        matrix @ pose.position_m + translation,
        product(rotation, pose.orientation),
        turning @ pose.covariance @ turning.T,
    )


def _message(header: Header, pose: _Pose) -> PoseWithCovarianceStamped:
    message = PoseWithCovarianceStamped(header=header)
    place, turn = message.pose.pose.position, message.pose.pose.orientation
    place.x, place.y, place.z = pose.position_m.tolist()
    turn.x, turn.y, turn.z, turn.w = pose.orientation.tolist()
    message.pose.covariance = pose.covariance.ravel()
    return message


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(CoffeeNode)
