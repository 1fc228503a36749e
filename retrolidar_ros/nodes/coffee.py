# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `coffee` node: poses of the objects of a task, until all are placed (paper §7.1)."""

from __future__ import annotations

import re

from geometry_msgs.msg import PoseWithCovarianceStamped, Vector3Stamped
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_msgs.msg import Bool, Header, String

from retrolidar_ros.msg import MarkerDetection, MarkerTrack
from retrolidar_ros.nodes.conversion import covariance_of, from_pose, to_ns, to_pose_msg
from retrolidar_ros.nodes.diagnostics import OK, WARN, Health, publish_health
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.placed_readings import PlacedReadings
from retrolidar_ros.nodes.qos import EVENTS, LATCHED, subscribe, topic_part
from retrolidar_ros.nodes.run import run
from retrolidar_ros.nodes.track_topics import SOURCES
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.next_view import best_place
from retrolidar_ros.tasks.objects import ObjectBoard
from retrolidar_ros.tasks.reading import Errors, Reading
from retrolidar_ros.tasks.survey import Survey

_TICK_S = 0.1
# How long a detection waits for the transform of its time.
_PATIENCE_S = 1.0


class CoffeeNode(Node):
    """Publishes poses and offsets of named objects, and whether all of them are placed."""

    def __init__(self) -> None:
        """Declare parameters and subscribe."""
        super().__init__('coffee')
        parameters = Parameters(self, 'coffee')
        parameters.declare('objects', 'TF frames of the markers on the objects.')
        parameters.declare('source', 'What readings are made of.', among=SOURCES)
        parameters.declare('target_frame', "Frame of the poses; empty = the sensor's.")
        parameters.declare(
            'max_stddev',
            'Largest standard deviation of a position, worst axis [m].',
            1e-4,
            10.0,
            live=True,
        )
        parameters.declare('stale_after', 'Lifetime of a detection [s].', 0.1, 86400.0, live=True)
        parameters.declare(
            'reach', 'Radius around the first viewpoint [m].', 0.01, 100.0, live=True
        )
        values = parameters.values
        self._reach_m = values['reach']
        self._began_m: Floats | None = None
        self._goal = ''
        self._board = ObjectBoard(values['objects'], values['max_stddev'], values['stale_after'])
        parameters.follow(self._change)
        self._target = values['target_frame']
        self._survey = Survey({}, Errors())
        self._published: tuple[str, str] | None = None
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
        if self._target:
            # In a fixed frame readings from several places accumulate.
            source = values['source']
            topic = 'tracks' if source == 'tracks' else 'markers'
            self._readings = PlacedReadings(
                self, [topic], source, self._target, _PATIENCE_S, self._place, self._forget
            )
        elif values['source'] == 'tracks':
            subscribe(self, MarkerTrack, 'tracks', self._take, EVENTS)
        else:
            subscribe(self, MarkerDetection, 'markers', self._take, EVENTS)
        parameters.warn_of_unknown()
        self.create_timer(_TICK_S, self._tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _change(self, values: dict[str, float]) -> None:
        self._board.max_stddev_m = values['max_stddev']
        self._board.stale_after_s = values['stale_after']
        self._reach_m = values['reach']

    def _forget(self) -> None:
        self._survey.forget()
        self._began_m, self._goal = None, ''

    def _take(self, message: MarkerDetection | MarkerTrack) -> None:
        """Publish the pose of an object from one detection."""
        if message.child_frame_id in self._poses and to_ns(message.header.stamp) >= 0:
            place = from_pose(message.pose.pose)
            covariance = covariance_of(message.pose)
            self._publish(message.child_frame_id, message.header, *place, covariance)
            self._tick()

    def _place(self, reading: Reading, message: MarkerDetection | MarkerTrack) -> None:
        """Publish the pose of an object from all readings."""
        name = message.child_frame_id
        if name not in self._poses:
            return
        if self._began_m is None:
            self._began_m = reading.pose.position_m
        estimate = self._survey.take(reading, name).estimate()
        if estimate is not None:
            header = Header(stamp=message.header.stamp, frame_id=self._target)
            place = (estimate.position_m, estimate.rotation, estimate.covariance)
            self._publish(name, header, *place)
        self._goal = self._next_place(self._began_m)
        self._tick()

    def _missing_now(self) -> dict[str, str]:
        return self._board.missing(self.get_clock().now().nanoseconds)

    def _next_place(self, began_m: Floats) -> str:
        """Return the next viewpoint for objects that are not known well enough."""
        known = self._survey.landmarks
        landmarks = [known[one] for one in self._missing_now() if one in known]
        place_m = best_place(landmarks, began_m, self._reach_m)
        if place_m is None:
            return ''
        return f'look from ({", ".join(f"{part:.2f}" for part in place_m)}) m in {self._target}'

    def _publish(
        self, name: str, header: Header, position_m: Floats, rotation: Floats, covariance: Floats
    ) -> None:
        stamp_ns, now_ns = to_ns(header.stamp), self.get_clock().now().nanoseconds
        if not self._board.see(name, stamp_ns, header.frame_id, position_m, covariance[:3, :3]):
            return
        self._poses[name].publish(to_pose_msg(header, position_m, rotation, covariance))
        for (one, other), offset in self._board.offsets(now_ns).items():
            if name in (one, other):
                way = Vector3Stamped(header=header)
                way.vector.x, way.vector.y, way.vector.z = offset.tolist()
                self._offsets[one, other].publish(way)

    def _tick(self) -> None:
        """Publish and log missing objects, why, and the next viewpoint; not for a number alone."""
        missing = self._missing_now()
        text = ', '.join(f'{name} {reason}' for name, reason in missing.items())
        goal = f'; {self._goal}' if self._goal and 'is known to' in text else ''
        news = re.sub(r'[-+.0-9]+', '', text), goal
        if self._published == news:
            return
        self._published = news
        text += goal
        self._missing.publish(String(data=text))
        self._ready.publish(Bool(data=not missing))
        self.get_logger().info(f'waiting: {text}' if missing else 'all objects are placed')

    def _examine(self) -> Health:
        missing = self._missing_now()
        values = {name: missing.get(name, 'placed') for name in self._board.names}
        if missing:
            return Health(WARN, f'{len(missing)} of {len(values)} objects missing', values)
        return Health(OK, f'{len(values)} objects placed', values)


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(CoffeeNode)
