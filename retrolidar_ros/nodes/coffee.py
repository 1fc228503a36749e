# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `coffee` node: poses of the objects of a task, until all are placed (paper §7.1)."""

import re
from itertools import combinations

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Vector3Stamped
from rclpy.node import Node
from std_msgs.msg import Bool, Header, String

from retrolidar_ros.nodes.conversion import (
    Marked,
    covariance_of,
    from_pose,
    to_ns,
    to_pose,
    to_pose_msg,
)
from retrolidar_ros.nodes.detection_subscriber import DetectionSubscriber, TransformedDetections
from retrolidar_ros.nodes.diagnostics import WARN, DiagnosticsPublisher, Health
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.qos import latched, topics_of
from retrolidar_ros.nodes.run import repeat
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.sensor.rotation import quaternion_of
from retrolidar_ros.tasks.next_view import ViewPlanner
from retrolidar_ros.tasks.objects import ObjectBoard
from retrolidar_ros.tasks.reading import Errors, Reading
from retrolidar_ros.tasks.survey import Survey

_TICK_S = 0.1
_PATIENCE_S = 1.0  # how long a detection waits for the transform of its time


class CoffeeNode(Node):
    """Publishes poses and offsets of named objects, and whether all of them are placed."""

    def __init__(self) -> None:
        super().__init__('coffee')
        parameters = Parameters(self, 'coffee')
        values = parameters.values
        self._prefix = values['frame_prefix']
        self._planner = ViewPlanner()
        self._board = ObjectBoard(values['objects'], values['max_stddev'], values['stale_after'])
        self._change(values)
        parameters.follow(self._change)
        self._target = values['target_frame']
        self._survey = Survey({}, Errors())
        self._published: tuple[str, str] | None = None
        self._ready = latched(self, Bool, '~/ready')
        self._missing = latched(self, String, '~/missing')
        self._next_view = latched(self, PoseStamped, '~/next_view')
        names = self._board.names
        self._poses = {
            name: latched(self, PoseWithCovarianceStamped, topic)
            for name, topic in topics_of('~/objects/', names).items()
        }
        pairs = {pair: '_to_'.join(pair) for pair in combinations(names, 2)}
        topics = topics_of('~/offsets/', [*pairs.values()])
        self._offsets = {
            pair: latched(self, Vector3Stamped, topics[name]) for pair, name in pairs.items()
        }
        DiagnosticsPublisher(self).register_health_check(self, 'objects', self._examine)
        self._readings: DetectionSubscriber
        if self._target:
            # In a fixed frame readings from several places accumulate.
            self._readings = TransformedDetections(
                self, self._target, _PATIENCE_S, self._on_reading, self._restart
            )
        else:
            self._readings = DetectionSubscriber(self, values['source'], self._on_detection)
        repeat(self, _TICK_S, self._tick)

    def _change(self, values: dict[str, float]) -> None:
        if values['min_height'] > values['max_height']:
            raise ValueError('min_height is above max_height')
        self._board.max_stddev_m = values['max_stddev']
        self._board.stale_after_s = values['stale_after']
        self._planner.reach_m, self._planner.move_s = values['reach'], values['move_time']
        self._planner.heights_m = values['min_height'], values['max_height']
        self._planner.max_stddev_m = values['max_stddev']

    def _restart(self) -> None:
        self._survey.restart()
        self._planner.forget()

    def _on_detection(self, message: Marked) -> None:
        name = message.child_frame_id.removeprefix(self._prefix)
        if name in self._poses:
            covariance = covariance_of(message.pose)
            self._publish(name, message.header, *from_pose(message.pose.pose), covariance)
            self._tick()

    def _on_reading(self, reading: Reading, message: Marked) -> None:
        name = message.child_frame_id.removeprefix(self._prefix)
        if name not in self._poses:
            return
        header = Header(stamp=message.header.stamp, frame_id=self._target)
        if (one := self._survey.take(name, reading).estimate()) is not None:
            self._publish(name, header, one.position_m, one.rotation, one.covariance)
        missing = {one: self._survey.landmarks.get(one) for one in self._missing_now()}
        before = self._planner.view
        self._planner.take(reading, name, missing)
        if (view := self._planner.view) is not None and view is not before:
            pose = to_pose(view.position_m, quaternion_of(view.rotation))
            self._next_view.publish(PoseStamped(header=header, pose=pose))
        self._tick()

    def _missing_now(self) -> dict[str, str]:
        return self._board.missing(self.get_clock().now().nanoseconds)

    def _advice(self) -> str:
        if not self._target:
            return '; set target_frame, and look from several places'
        view = self._planner.view
        if view is None:
            return ''
        position = ', '.join(f'{part:.2f}' for part in view.position_m)
        return f'; look from ({position}) m in {self._target}'

    def _publish(
        self, name: str, header: Header, position_m: Floats, rotation: Floats, covariance: Floats
    ) -> None:
        stamp_ns, now_ns = to_ns(header.stamp), self.get_clock().now().nanoseconds
        if not self._board.see(name, stamp_ns, header.frame_id, position_m, covariance[:3, :3]):
            return
        self._poses[name].publish(to_pose_msg(header, position_m, rotation, covariance))
        for (one, other), offset in self._board.offsets(now_ns).items():
            if name in (one, other):
                message = Vector3Stamped(header=header)
                message.vector.x, message.vector.y, message.vector.z = offset.tolist()
                self._offsets[one, other].publish(message)

    def _tick(self) -> None:
        """Publish and log missing objects, why, and the next viewpoint; not for a number alone."""
        missing = self._missing_now()
        unsure = [name for name, reason in missing.items() if 'needed' in reason]
        for name in set(unsure) & self._planner.remedies.keys():
            missing[name] = f'{missing[name].removesuffix(")")}: {self._planner.remedies[name]})'
        text = ', '.join(f'{name} {reason}' for name, reason in missing.items())
        advice = self._advice() if unsure else ''
        news = re.sub(r'[-+.0-9]+', '', text), advice
        if self._published == news:
            return
        self._published = news
        text += advice
        self._missing.publish(String(data=text))
        self._ready.publish(Bool(data=not missing))
        self.get_logger().info(f'waiting: {text}' if missing else 'all objects are placed')

    def _examine(self) -> Health:
        missing = self._missing_now()
        values = {name: missing.get(name, 'placed') for name in self._board.names}
        problems = []
        if missing:
            problems.append((WARN, f'{len(missing)} of {len(values)} objects missing'))
        fine = f'{len(values)} objects placed'
        return Health(self._readings.examine(values) + problems, values, fine)
