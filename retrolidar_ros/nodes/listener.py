# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A node that collects what driver and detector publish, for the demo and the tests."""

import time
from collections.abc import Callable

import rclpy
from geometry_msgs.msg import TransformStamped
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from tf2_msgs.msg import TFMessage

from retrolidar_ros.detector import Detection
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import from_detection_msg, from_frame_msg, to_ns
from retrolidar_ros.sensor.frame import Recording


class Listener:
    """Subscribes to `frames` and `markers` of a namespace and to `/tf`, and keeps all messages."""

    def __init__(self, namespace: str) -> None:
        """Join the graph; the context is this object's own."""
        self.frames: list[tuple[FrameMsg, int]] = []  # each with the host time of its receipt [ns]
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

    def readings(self) -> list[Detection]:
        """Return the detections so far."""
        return [from_detection_msg(message) for message, _ in self.markers]

    def untransformed(self) -> set[int]:
        """Return the IDs of detections whose transforms have not come."""

        def key(message: TransformStamped | MarkerDetection) -> tuple[str, int]:
            return message.child_frame_id, to_ns(message.header.stamp)

        sent = set(map(key, self.transforms))
        return {message.id for message, _ in self.markers if key(message) not in sent}

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)
