# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `heartbeat` node: warns when a marker is overdue, and counts how often it came (§7.2)."""

from rclpy.node import Node
from std_msgs.msg import Bool

from retrolidar_ros.msg import MarkerTrack
from retrolidar_ros.nodes.conversion import Marked, to_ns
from retrolidar_ros.nodes.detection_subscriber import DetectionSubscriber
from retrolidar_ros.nodes.diagnostics import WARN, DiagnosticsPublisher, Health
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.qos import latched
from retrolidar_ros.nodes.run import repeat
from retrolidar_ros.tasks.heartbeat import Heartbeat

_TICK_S = 0.02


class HeartbeatNode(Node):
    """Publishes whether all of some markers were read recently."""

    def __init__(self) -> None:
        super().__init__('heartbeat')
        self._settings = Parameters(self, 'heartbeat')
        self._settings.follow()
        values = self._settings.values
        self._prefix = values['frame_prefix']
        if not values['markers']:
            raise ValueError('markers: there is no name; name at least one')
        self._hearts = {name: Heartbeat(values['window']) for name in values['markers']}
        self._overdue: set[str] = set()
        self._is_alive: bool | None = None
        self._alive = latched(self, Bool, '~/alive')
        DiagnosticsPublisher(self).register_health_check(self, 'markers', self._examine)
        self._detections = DetectionSubscriber(self, values['source'], self._on_detection)
        repeat(self, _TICK_S, self._tick)

    def _now_s(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _on_detection(self, message: Marked) -> None:
        name = message.child_frame_id.removeprefix(self._prefix)
        now_s = self._now_s()
        if name in self._hearts and now_s:
            unseen_s = 0.0
            if isinstance(message, MarkerTrack):
                unseen_s = 1e-9 * (to_ns(message.header.stamp) - to_ns(message.last))
            self._hearts[name].beat(now_s, max(unseen_s, 0.0))
            self._tick()

    def _tick(self) -> None:
        now_s = self._now_s()
        if not now_s:  # a simulated clock that does not tick yet
            return
        overdue = set()
        for name, heart in self._hearts.items():
            heart.advance(now_s)
            if heart.silence_s(now_s) > self._settings.values['overdue_after']:
                overdue.add(name)
        for name in sorted(overdue - self._overdue):
            self.get_logger().warning(
                f'{name} is overdue: not read for {self._hearts[name].silence_s(now_s):.1f} s'
            )
        for name in sorted(self._overdue - overdue):
            self.get_logger().info(f'{name} is back')
        self._overdue = overdue
        is_alive = not overdue and all(heart.beats for heart in self._hearts.values())
        if is_alive != self._is_alive:
            self._is_alive = is_alive
            self._alive.publish(Bool(data=is_alive))

    def _examine(self) -> Health:
        now_s = self._now_s()
        values = {}
        for name, heart in self._hearts.items():
            values[f'{name}: readings'] = str(heart.beats)
            values[f'{name}: windows with a reading'] = f'{heart.windows_alive} of {heart.windows}'
            values[f'{name}: silence [s]'] = f'{heart.silence_s(now_s):.1f}'
            values[f'{name}: longest silence [s]'] = f'{heart.longest_silence_s(now_s):.1f}'
        problems = self._detections.examine(values)
        if self._overdue:
            problems.append((WARN, f'overdue: {", ".join(sorted(self._overdue))}'))
        elif not self._is_alive:
            problems.append((WARN, 'not all markers have been read yet'))
        return Health(problems, values, 'all markers are read')
