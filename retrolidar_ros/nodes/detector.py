# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `detector` node: from `frames` to `markers`, TF and visualization topics."""

import time
from threading import Lock
from typing import Any

from rclpy.logging import LoggingSeverity
from rclpy.node import Node

from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.parameters import READING, DetectorSettings
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import from_frame_msg
from retrolidar_ros.nodes.detector_health import NO_FRAME, DetectorHealth
from retrolidar_ros.nodes.detector_topics import DetectorTopics
from retrolidar_ros.nodes.diagnostics import WARN, DiagnosticsPublisher, Health, ProblemLog
from retrolidar_ros.nodes.parameters import Parameters, child_frame_of
from retrolidar_ros.nodes.qos import FRAME_QOS, subscribe
from retrolidar_ros.nodes.transforms import TransformSender
from retrolidar_ros.sensor.frame import Frame, ZoneGrid


class DetectorNode(Node):
    """Publishes every marker that is read, as a message and as a transform."""

    def __init__(
        self,
        board: DiagnosticsPublisher | None = None,
        sender: TransformSender | None = None,
        **options: Any,
    ) -> None:
        """Declare parameters and subscribe.

        Board and sender are those of the process, if it has them; frames then come by
        `process_frame`.
        """
        super().__init__('detector', **options)
        parameters = Parameters(self, 'detector')
        self._values = parameters.values
        self._values['child_frame'] = child_frame_of(self._values)
        settings = DetectorSettings(self._values)
        # The first frame tells the zone grid, but impossible parameters are to fail at the start.
        self._health = DetectorHealth(ZoneGrid())
        self._begin(settings, ZoneGrid())
        self._sender = sender or TransformSender(self)
        self._topics = DetectorTopics(self, settings.known, self._values, self._sender)
        self._frame_id = ''
        self._number: int | None = None
        self._log = ProblemLog(self)
        self._lock = Lock()  # frames and parameters may come in different threads
        parameters.follow(self._change)
        self.get_logger().info(f'reading markers by method {self._values["method"]}')
        (board or DiagnosticsPublisher(self)).register_health_check(self, 'markers', self._examine)
        self._topic = (
            '' if board else subscribe(self, FrameMsg, 'frames', self._on_frame, FRAME_QOS)
        )

    def _begin(self, settings: DetectorSettings, grid: ZoneGrid) -> None:
        self._detector = settings.detector(grid)
        self._agreement = Agreement(settings.values['min_readings'])
        self._settings, self._grid = settings, grid
        self._health.restart(grid)

    def _change(self, values: dict[str, Any]) -> None:
        with self._lock:
            if any(values[name] != self._values[name] for name in READING):
                self._begin(self._settings.changed(**values), self._grid)
                self.get_logger().info('the detector restarts with other parameters')
            self._topics.change(values)
            self._values = values

    def _on_frame(self, message: FrameMsg, info: dict[str, Any]) -> None:
        # DDS numbers the messages of a publisher. Older rclpy and some middleware do not.
        before, self._number = self._number, info.get('publication_sequence_number')
        max_lost = None
        if before is not None and self._number is not None:
            max_lost = max(self._number - before - 1, 0)
        try:
            if not message.header.frame_id:
                raise ValueError('its frame_id is empty')
            frame = from_frame_msg(message)
            if frame.stamp_ns < 0:
                raise ValueError(f'its stamp of {frame.stamp_ns} ns is negative')
        except ValueError as error:
            self._health.drop(str(error))
            return
        self.process_frame(frame, message.header.frame_id, max_lost)

    def process_frame(self, frame: Frame, frame_id: str, max_lost: int | None = 0) -> None:
        """Read markers with the next frame, before which at most `max_lost` were lost."""
        with self._lock:
            began_s = time.perf_counter()
            if self._frame_id not in ('', frame_id):
                self._health.foreign += 1
            if frame.grid != self._grid or frame_id != self._frame_id:
                self._frame_id = frame_id
                self._begin(self._settings, frame.grid)
            age_s = (self.get_clock().now().nanoseconds - frame.stamp_ns) * 1e-9
            if self._health.monitor.take(frame, max_lost):
                self._read(frame, frame_id)
            self._topics.beat(frame.stamp_ns, frame_id)
            self._health.done(frame.stamp_ns, time.perf_counter() - began_s, age_s)

    def _read(self, frame: Frame, frame_id: str) -> None:
        detections = self._detector.update(frame)
        if self.get_logger().is_enabled_for(LoggingSeverity.DEBUG):
            for one in self._detector.candidates:
                if one.reason:
                    self.get_logger().debug(
                        f'rejected: {one.reason.value}: ID {one.id}, evidence {one.evidence:.1f}, '
                        f'word {one.word:.1f}, margin {one.margin:.1f} nats'
                    )
        if detections:
            self._health.read(detections)
            if confirmed := self._agreement.confirmed(detections):
                self._topics.publish(confirmed, frame.stamp_ns, frame_id)
        self._topics.follow(self._detector, self._agreement, frame, frame_id)

    def _examine(self) -> Health:
        # Includes nodes that have just been killed.
        found = self.get_publishers_info_by_topic(self._topic) if self._topic else []
        publishers = [f'{one.node_namespace.rstrip("/")}/{one.node_name}' for one in found]
        with self._lock:
            counts = self._detector.counts
            health = self._health.examine(self._settings, counts, publishers)
            health.values['withheld by min_readings'] = str(self._agreement.withheld)
        self._sender.listen()
        if shared := self._sender.problem(self._frame_id):
            health.problems.append((WARN, shared))
        for _, text in health.problems:
            if not text.startswith(NO_FRAME):
                self._log.warn(text)
        return health
