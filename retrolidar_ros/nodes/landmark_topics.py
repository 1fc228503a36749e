# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The topics of landmarks: a pose for each, its transform, and shapes of all."""

from collections.abc import Sequence

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header
from tf2_ros import TransformBroadcaster
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.nodes.conversion import to_header, to_pose_msg, to_transform
from retrolidar_ros.nodes.parameters import NAME
from retrolidar_ros.nodes.qos import LATCHED, latched, publisher, topic_part
from retrolidar_ros.nodes.transforms import TransformFinder
from retrolidar_ros.nodes.visualization import landmark_shapes
from retrolidar_ros.tasks.landmarks import Estimate


class LandmarkTopics:
    """Publishes landmarks in a fixed frame."""

    def __init__(
        self, node: Node, finder: TransformFinder, fixed_frame: str, child_frame: str, send: bool
    ) -> None:
        """Make the publishers; `send` transforms to `child_frame`, with a name for its NAME."""
        self._finder = finder
        self._node = node
        self._fixed = fixed_frame
        self._child_frame = child_frame
        self._poses: dict[str, Publisher] = {}
        self._taken: set[str] = set()  # frames that have another parent
        self._broadcaster = TransformBroadcaster(node) if send else None
        self._shapes = publisher(node, MarkerArray, '~/marker_array', LATCHED)
        self.shapes_due = False  # whether landmarks have changed since their shapes were sent

    def publish(self, estimate: Estimate) -> None:
        """Publish the pose of a landmark, and its transform."""
        name = estimate.name
        header = to_header(round(max(estimate.stamp_s, 0.0) * 1e9), self._fixed)
        if name not in self._poses:
            topic = f'~/objects/{topic_part(name)}'
            self._poses[name] = latched(self._node, PoseWithCovarianceStamped, topic)
            deviation_mm = 1e3 * estimate.stddev_m
            self._node.get_logger().info(f'{name} is placed, to ±{deviation_mm:.0f} mm so far')
            self._check_frames()
        message = to_pose_msg(header, estimate.position_m, estimate.rotation, estimate.covariance)
        self._poses[name].publish(message)
        self.shapes_due = True
        child = self._frame_of(name)
        if self._broadcaster is not None and child not in self._taken:
            self._broadcaster.sendTransform([to_transform(header, child, message.pose.pose)])

    def _frame_of(self, name: str) -> str:
        return self._child_frame.replace(NAME, name)

    def _check_frames(self) -> None:
        """Stop sending frames to which another node gives another parent."""
        parents = self._finder.parents()
        for child in map(self._frame_of, self._poses):
            parent = parents.get(child, self._fixed)
            if self._broadcaster is not None and parent != self._fixed and child not in self._taken:
                self._taken.add(child)
                self._node.get_logger().error(
                    f'no transform from {self._fixed} to {child} is sent: its parent in TF is '
                    f'{parent}, by another node; set child_frame'
                )

    def forget(self) -> None:
        """Forget all landmarks: their latched poses, too, and whose frames others send."""
        for pose in self._poses.values():
            self._node.destroy_publisher(pose)
        self._poses.clear()
        self._taken.clear()
        self.shapes_due = True

    def update(self, estimates: Sequence[Estimate]) -> None:
        """Check frames, and publish the shapes of all landmarks if any changed; once a second."""
        self._check_frames()
        if self.shapes_due and self._shapes.get_subscription_count():
            self.shapes_due = False
            stamp = self._node.get_clock().now().to_msg()
            shapes = landmark_shapes(Header(stamp=stamp, frame_id=self._fixed), estimates)
            self._shapes.publish(MarkerArray(markers=shapes))
