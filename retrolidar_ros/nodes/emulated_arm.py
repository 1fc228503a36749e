# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `emulated_arm` node: TF and description of an arm that moves the emulated sensor."""

import time
from functools import partial
from xml.sax.saxutils import quoteattr

import numpy as np
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, qos_profile_sensor_data
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from tf2_ros import TransformBroadcaster

from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import to_header, to_pose, to_transform
from retrolidar_ros.nodes.parameters import Parameters, check_frame_id
from retrolidar_ros.nodes.qos import EVENTS, latched
from retrolidar_ros.nodes.run import repeat
from retrolidar_ros.scene.description import Waypoint, load_scene
from retrolidar_ros.scene.optics import along, rotation_of
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import quaternion_of

IN_BASE = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""Turns directions of a scene into those of the arm's base: x ahead, y left, z up (REP 103)."""
_PERIOD_S = 0.02
_LISTENING_S = 3.0  # waits so long for another arm before it starts
_PAST_S = 8.0  # of poses that are sent then, as readings may wait for them; TF keeps ten seconds
_STATIC = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
_STILL = (Waypoint(0.0, (0.0, 0.0, 0.0)),)
# A pillar behind the scene's origin, and a hand behind the sensor.
_DESCRIPTION = """<robot name="emulated_arm">
  <link name={base}><visual><origin xyz="-0.5 0 -0.4"/>
    <geometry><cylinder radius="0.08" length="0.8"/></geometry></visual></link>
  <link name={sensor}><visual><origin xyz="0 0 -0.06"/>
    <geometry><box size="0.06 0.06 0.12"/></geometry></visual></link>
  <joint name="arm" type="floating"><parent link={base}/><child link={sensor}/></joint>
</robot>"""


class EmulatedArmNode(Node):
    """Sends the transform of a sensor that moves as a scene says, and a robot description."""

    def __init__(self) -> None:
        super().__init__('emulated_arm')
        values = Parameters(self, 'emulated_arm').values
        self._base = check_frame_id('fixed_frame', values['fixed_frame'])
        try:
            self._path = load_scene(values['scene']).sensor.path or _STILL
        except FileNotFoundError as error:
            raise ValueError(f'scene: {error}') from error
        self._start_s = values['start']
        self._sensor = ''
        self._moved: set[str] = set()
        self._began_s = time.monotonic()
        self._broadcaster = TransformBroadcaster(self)
        self._description = latched(self, String, 'robot_description')
        self._transforms = self.create_subscription(TFMessage, '/tf', self._on_transforms, EVENTS)
        self.create_subscription(TFMessage, '/tf_static', self._on_transforms, _STATIC)
        self._frames = self.create_subscription(
            FrameMsg, 'frames', self._on_frame, qos_profile_sensor_data
        )
        self.get_logger().info('waiting for frames, and whether another arm moves the sensor')
        repeat(self, _PERIOD_S, partial(self._send_poses, np.zeros(1)))

    def _on_frame(self, message: FrameMsg) -> None:
        if time.monotonic() < self._began_s + _LISTENING_S:
            return
        self.destroy_subscription(self._frames)
        # From now on it would hear its own.
        self.destroy_subscription(self._transforms)
        self._sensor = message.header.frame_id
        if self._gives_way():
            return
        names = {'base': quoteattr(self._base), 'sensor': quoteattr(self._sensor)}
        self._description.publish(String(data=_DESCRIPTION.format(**names)))
        self.get_logger().info(f'sending the transform from {self._base} to {self._sensor}')
        self._send_poses(np.arange(_PAST_S, 0.0, -_PERIOD_S))

    def _on_transforms(self, message: TFMessage) -> None:
        """Note what other nodes move: a real arm has priority over this one."""
        self._moved.update(transform.child_frame_id for transform in message.transforms)
        self._gives_way()

    def _gives_way(self) -> bool:
        """Stop sending if another node moves the sensor; return whether one does."""
        if self._sensor not in self._moved:
            return False
        self.get_logger().info(f'{self._sensor} has another parent in TF: that arm is used')
        self._sensor = ''
        return True

    def _send_poses(self, ago_s: Floats) -> None:
        """Send the poses that the sensor had so long ago, shape (n,), once it is known."""
        if not self._sensor:
            return
        now_ns = self.get_clock().now().nanoseconds
        ago_s = ago_s[ago_s * 1e9 <= now_ns]  # a simulated clock may have begun later
        times_s = np.maximum(time.monotonic() - self._start_s - ago_s, 0.0)
        positions_m, rotation_vectors = along(self._path, times_s)
        transforms = []
        for past_s, position_m, turn in zip(
            ago_s, positions_m, rotation_of(rotation_vectors), strict=True
        ):
            header = to_header(now_ns - round(past_s * 1e9), self._base)
            pose = to_pose(IN_BASE @ position_m, quaternion_of(IN_BASE @ turn))
            transforms.append(to_transform(header, self._sensor, pose))
        self._broadcaster.sendTransform(transforms)
