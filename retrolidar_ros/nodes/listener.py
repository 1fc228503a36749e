# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A node that collects what driver and detector publish, for the demo and the tests."""

from __future__ import annotations

import time
from collections.abc import Callable

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import covariance_of, from_frame_msg, to_ns, vector_of
from retrolidar_ros.scene.truth import Heard
from retrolidar_ros.sensor.frame import Recording


class Listener:
    """Subscribes to `frames` and `markers` of a namespace and to `/tf`, and keeps all messages."""

    def __init__(self, namespace: str) -> None:
        """Join the graph; the context is this object's own."""
        self.frames: list[tuple[FrameMsg, int]] = []
        """Each with the host time of its receipt [ns]."""
        self.markers: list[tuple[MarkerDetection, int]] = []
        self.transforms: list[TransformStamped] = []
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = Node('listener', namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        reliable = QoSProfile(depth=1000, reliability=ReliabilityPolicy.RELIABLE)
        self.node.create_subscription(
            FrameMsg, 'frames', lambda m: self.frames.append((m, time.time_ns())), reliable
        )
        self.node.create_subscription(
            MarkerDetection, 'markers', lambda m: self.markers.append((m, time.time_ns())), reliable
        )
        self.node.create_subscription(TFMessage, '/tf', self._take_transforms, reliable)

    def _take_transforms(self, message: TFMessage) -> None:
        self.transforms.extend(message.transforms)

    def spin_until(self, done: Callable[[], bool], timeout_s: float) -> bool:
        """Process messages until `done` returns true; return False after the timeout."""
        deadline = time.monotonic() + timeout_s
        while not done():
            remaining_s = deadline - time.monotonic()
            if remaining_s < 0:
                return False
            self._executor.spin_once(timeout_sec=min(remaining_s, 0.1))
        return True

    def is_connected(self) -> bool:
        """Return whether driver and detector run and are connected."""
        return (
            self.node.count_publishers('frames') > 0
            and self.node.count_publishers('markers') > 0
            and self.node.count_publishers('/tf') > 0
            and self.node.count_subscribers('frames') > 1
        )

    def recording(self) -> Recording | None:
        """Return the frames so far; None if there are none."""
        return Recording.of([from_frame_msg(m) for m, _ in self.frames]) if self.frames else None

    def heard(self) -> list[Heard]:
        """Return the detections so far."""
        transforms = {(t.child_frame_id, to_ns(t.header.stamp)) for t in self.transforms}
        heard = []
        for message, _ in self.markers:
            stamp_ns = to_ns(message.header.stamp)
            heard.append(
                Heard(
                    id=message.id,
                    start_ns=to_ns(message.start),
                    stamp_ns=stamp_ns,
                    end_ns=to_ns(message.end),
                    range_m=message.range,
                    snr_db=message.snr,
                    position_m=tuple(vector_of(message.pose.pose.position).tolist()),
                    covariance=covariance_of(message.pose)[:3, :3],
                    zone=message.zones[0],
                    bit_period_s=message.bit_period,
                    has_transform=(message.child_frame_id, stamp_ns) in transforms,
                )
            )
        return heard

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)
