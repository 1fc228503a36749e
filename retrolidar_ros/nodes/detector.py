# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `detector` node: from `frames` to `markers`, TF and visualization topics."""

import time
from threading import Lock
from typing import Any

from rclpy.logging import LoggingSeverity
from rclpy.node import Node

from retrolidar_ros.detector import Detection, DetectorCounts
from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.frame_monitor import FrameMonitor
from retrolidar_ros.detector.parameters import READING, DetectorSettings
from retrolidar_ros.marker.known_markers import frame_of
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.nodes.conversion import from_frame_msg
from retrolidar_ros.nodes.detector_topics import DetectorTopics
from retrolidar_ros.nodes.diagnostics import (
    ERROR,
    PERIOD_S,
    STALE,
    WARN,
    DiagnosticsPublisher,
    Health,
    ProblemLog,
)
from retrolidar_ros.nodes.parameters import Parameters, child_frame_of
from retrolidar_ros.nodes.qos import FRAME_QOS, subscribe
from retrolidar_ros.nodes.transforms import TransformSender
from retrolidar_ros.sensor.frame import Frame, ZoneGrid, stamps_stand

_SILENCE_S = 2.0
_MIXED = 2  # a sensor that restarts resets its counter once
_OVERLOADED = 3  # of about six searches a second; a single one does no harm
NO_FRAME = 'no frame has come'


class DetectorHealth:
    """Counts frames and detections."""

    def __init__(self, grid: ZoneGrid) -> None:
        self.monitor = FrameMonitor(grid)
        self.foreign = 0  # frames from another TF frame than the one before
        self._dropped = 0
        self._reason = ''
        self._frame_s = self._examined_s = time.monotonic()
        self._busy_s = self._age_s = 0.0
        self._stamp_ns = self._examined_ns = 0
        self._read_s: dict[int, float] = {}
        self._then = self._counts(DetectorCounts())

    def restart(self, grid: ZoneGrid) -> None:
        """Restart watching; the counts go on, except those of the detector."""
        self.monitor.restart(grid)
        self._then['overloads'] = 0

    def drop(self, reason: str) -> None:
        """Count an unusable frame."""
        self._dropped += 1
        self._reason = reason

    def done(self, stamp_ns: int, busy_s: float, age_s: float) -> None:
        """Count the processing time of a frame, and its age."""
        self._stamp_ns = stamp_ns
        self._frame_s = time.monotonic()
        self._busy_s += busy_s
        self._age_s += age_s

    def read(self, detections: list[Detection]) -> None:
        """Count detections."""
        self.monitor.read(detections)
        for detection in detections:
            self._read_s[detection.id] = time.monotonic()

    def _counts(self, counts: DetectorCounts) -> dict[str, int]:
        return {
            'frames': self.monitor.frames,
            'lost frames': self.monitor.lost,
            'frames not sent': self.monitor.unsent,
            'repeated frames': self.monitor.repeated,
            'frames out of order': self.monitor.reversed,
            'frames of another sensor': self.foreign,
            'dropped frames': self._dropped,
            'overloads': counts.overloads,
        }

    def examine(
        self, settings: DetectorSettings, counts: DetectorCounts, publishers: list[str]
    ) -> Health:
        """Judge the time since the last call."""
        now = self._counts(counts)
        new = {name: number - self._then[name] for name, number in now.items()}
        self._then = now
        advance_ns, self._examined_ns = self._stamp_ns - self._examined_ns, self._stamp_ns
        frames = max(new['frames'], 1)
        values = {
            'method': settings.values['method'],
            'processing [ms a frame]': f'{1e3 * self._busy_s / frames:.2f}',
            'age of frames when processed [ms]': f'{1e3 * self._age_s / frames:.1f}',
            'publishers of frames': str(len(publishers)),
            'candidates': str(counts.candidates),
            'accepted': str(counts.accepted),
            'impossible samples': str(counts.impossible),
            **{name: str(number) for name, number in now.items()},
            **{f'rejected: {name}': str(one) for name, one in sorted(counts.rejected.items())},
        }
        self._busy_s = self._age_s = 0.0
        now_s = time.monotonic()
        for identity in sorted({*settings.known, *settings.registered}):
            read_s = self._read_s.get(identity)
            age = 'never' if read_s is None else f'{now_s - read_s:.1f}'
            values[f'since last reading of {frame_of(identity, settings.known)} [s]'] = age
        # While this process was suspended, it received nothing.
        self._frame_s += max(now_s - self._examined_s - PERIOD_S, 0.0)
        self._examined_s, silence_s = now_s, now_s - self._frame_s
        if not now['frames'] and not new['dropped frames']:
            return Health([(WARN, f'{NO_FRAME} yet')], values)
        if silence_s > _SILENCE_S and not new['dropped frames']:
            return Health([(STALE, f'{NO_FRAME} for {silence_s:.0f} s')], values)
        problems = self._disturbances(new, publishers)
        unread = self.monitor.unread(settings)
        if stamps_stand(new['frames'] - new['repeated frames'], advance_ns):
            problems.append((ERROR, 'the stamps of frames stand still: has /clock stopped?'))
        elif rate := self.monitor.rate(settings.values['bit_period']):
            problems.append((WARN, str(rate)))
        if unread:
            problems.append((WARN, str(unread)))
        rejected = sum(counts.rejected.values())
        return Health(problems, values, f'{counts.accepted} packets accepted, {rejected} rejected')

    def _disturbances(self, new: dict[str, int], publishers: list[str]) -> list[tuple[bytes, str]]:
        problems = []
        names = ('frames of another sensor', 'frames out of order', 'repeated frames')
        mixed = {name: new[name] for name in names if new[name]}
        if sum(mixed.values()) >= _MIXED:
            by = f' by {", ".join(sorted(publishers))}' if len(publishers) > 1 else ''
            how = ', '.join(f'{count} {name}' for name, count in mixed.items())
            text = f'frames of several sensors come mixed{by}: {how}; one detector reads one sensor'
            problems.append((ERROR, text))
        elif lost := new['lost frames']:
            text = (
                f'{lost} frames were lost between driver and detector, {self.monitor.lost} in all'
            )
            problems.append((WARN, f'{text}: this host is too slow, or the network'))
        elif unsent := new['frames not sent']:
            text = f'{unsent} frames were not sent: lost before the driver, or it was not active'
            problems.append((WARN, text))
        if dropped := new['dropped frames']:
            problems.append((ERROR, f'{dropped} frames cannot be used: {self._reason}'))
        if (overloads := new['overloads']) >= _OVERLOADED:
            text = f'search overloaded in {overloads} frames: more candidates than the limit'
            problems.append((WARN, f'{text}; reduce max_packets'))
        return problems


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
