# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `detector` node: from `frames` to `markers`, TF and what people look at."""

from __future__ import annotations

import time
from typing import Any

from rclpy.logging import LoggingSeverity
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from retrolidar_ros.detector import METHODS, Detection, Detector, create_detector
from retrolidar_ros.detector.likelihood_detector import LikelihoodDetector
from retrolidar_ros.detector.methods import MAX_PACKETS
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.code import BIT_PERIOD_LIMITS_S, IDS
from retrolidar_ros.marker.known_markers import frame_of
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import from_frame_msg, to_detection_msg, to_transform
from retrolidar_ros.nodes.diagnostics import OK, STALE, WARN, Health, publish_health
from retrolidar_ros.nodes.parameters import Parameters, known_markers
from retrolidar_ros.nodes.run import run
from retrolidar_ros.nodes.transforms import transform_sender
from retrolidar_ros.nodes.visualization import marker_shapes
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.frame_rate import RATE_FRAMES, rate_mismatch

_SILENCE_S = 2.0
_NAME = '{name}'
# What a change of these costs: the frames that the detector has seen so far.
_OF_DETECTOR = (
    'method',
    'bit_period',
    'false_ids_per_hour',
    'max_packets',
    'registered_ids',
    'only_registered',
    'noise_floor',
    'noise_slope',
    'noise_ambient',
    'likelihood_threshold',
)


class DetectorNode(Node):
    """Publishes every marker that is read, as a message and as a transform."""

    def __init__(self) -> None:
        """Declare parameters and subscribe."""
        super().__init__('detector')
        parameters = Parameters(self, 'detector')
        _declare(parameters)
        parameters.warn_of_unknown()
        self._values = parameters.values
        if self._values['child_frame'].count(_NAME) != 1:
            raise ValueError(f'child_frame: {self._values["child_frame"]!r} needs {_NAME} once')
        self._known = known_markers(self._values['marker_file'])
        # The zones are known with the first frame, but what cannot be is to be said at the start.
        self._grid = ZoneGrid()
        self._detector = self._new_detector(self._values, self._grid)
        self._send_transforms = transform_sender(self) if self._values['publish_tf'] else None
        parameters.follow(self._change)
        self._frames = 0
        self._frame_id = ''
        self._heard_s = time.monotonic()
        self._first_stamps_ns: list[int] = []
        self._busy_s = self._age_s = 0.0
        self._examined_frames = 0
        self._read_s: dict[int, float] = {}
        reliable = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE)
        self._publisher = self.create_publisher(MarkerDetection, 'markers', reliable)
        self._shapes = self.create_publisher(MarkerArray, 'marker_array', reliable)
        self.get_logger().info(f'reading markers by method {self._values["method"]}')
        publish_health(self, 'markers', '', self._examine)
        self.create_subscription(
            FrameMsg,
            'frames',
            self._detect,
            QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
        )

    def _new_detector(self, values: dict[str, Any], grid: ZoneGrid) -> Detector:
        registered = self._registered(values)
        return create_detector(
            values['method'],
            grid,
            bit_period_s=values['bit_period'],
            likelihood_threshold=values['likelihood_threshold'],
            false_ids_per_hour=values['false_ids_per_hour'],
            max_packets=values['max_packets'],
            registered_ids=registered or None,
            noise=NoiseLaw(values['noise_floor'], values['noise_slope'], values['noise_ambient']),
            marker_sizes_m={marker.id: marker.size_m for marker in self._known.values()},
        )

    def _registered(self, values: dict[str, Any]) -> list[int]:
        """Return the only IDs that may come; empty = all."""
        registered = set(values['registered_ids'])
        if values['only_registered']:
            if not self._known:
                raise ValueError('only_registered: there is no marker_file with markers')
            registered |= set(self._known)
        return sorted(registered)

    def _change(self, values: dict[str, Any]) -> None:
        """Take new values; ValueError if they cannot be."""
        if any(values[name] != self._values[name] for name in _OF_DETECTOR):
            self._detector = self._new_detector(values, self._grid)
            self._first_stamps_ns.clear()
            self.get_logger().info('the detector begins anew with other parameters')
        if values['publish_tf'] and self._send_transforms is None:
            self._send_transforms = transform_sender(self)
        self._values = values

    def _detect(self, message: FrameMsg) -> None:
        try:
            if not message.header.frame_id:
                raise ValueError('its frame_id is empty')
            frame = from_frame_msg(message)
            if frame.stamp_ns < 0:
                raise ValueError(f'its stamp of {frame.stamp_ns} ns is negative')
        except ValueError as error:
            self.get_logger().error(f'frame dropped: {error}', throttle_duration_sec=5.0)
            return
        began_s = time.perf_counter()
        self._frames += 1
        self._heard_s = time.monotonic()
        self._age_s += (self.get_clock().now().nanoseconds - frame.stamp_ns) * 1e-9
        self._check_rate(frame.stamp_ns)
        frame_id = message.header.frame_id
        if self._frame_id not in ('', frame_id):
            self.get_logger().warning(
                f'frames come from {self._frame_id} and from {frame_id}: one detector reads one '
                f'sensor; the detector begins anew',
                throttle_duration_sec=5.0,
            )
        if frame.grid != self._grid or frame_id != self._frame_id:
            self._grid, self._frame_id = frame.grid, frame_id
            self._detector = self._new_detector(self._values, frame.grid)
        detections = self._detector.update(frame)
        if self.get_logger().is_enabled_for(LoggingSeverity.DEBUG):
            self._log_refused()
        if detections:
            self._publish(detections, frame_id)
        self._busy_s += time.perf_counter() - began_s

    def _publish(self, detections: list[Detection], frame_id: str) -> None:
        messages = []
        for detection in detections:
            name = frame_of(detection.id, self._known)
            child_frame_id = self._values['child_frame'].replace(_NAME, name)
            messages.append(to_detection_msg(detection, frame_id, child_frame_id))
            self._read_s[detection.id] = time.monotonic()
        for message in messages:
            self._publisher.publish(message)
        if self._values['publish_tf'] and self._send_transforms is not None:
            self._send_transforms([to_transform(message) for message in messages])
        if self._shapes.get_subscription_count():
            stale_after_s = self._values['stale_after']
            shapes = [shape for one in messages for shape in marker_shapes(one, stale_after_s)]
            self._shapes.publish(MarkerArray(markers=shapes))

    def _log_refused(self) -> None:
        """Log the candidates that the newest frame has made judged and refused."""
        if not isinstance(self._detector, LikelihoodDetector):
            return
        for candidate in self._detector.candidates:
            if candidate.reason is not None:
                self.get_logger().debug(
                    f'refused: {candidate.reason.value}: ID {candidate.id}, '
                    f'evidence {candidate.evidence:.1f}, word {candidate.word:.1f}, '
                    f'margin {candidate.margin:.1f} nats'
                )

    def _check_rate(self, stamp_ns: int) -> None:
        """Warn once if a bit does not last two frames, as all methods suppose."""
        if len(self._first_stamps_ns) == RATE_FRAMES:
            return
        self._first_stamps_ns.append(stamp_ns)
        if len(self._first_stamps_ns) < RATE_FRAMES:
            return
        if mismatch := rate_mismatch(self._first_stamps_ns, self._values['bit_period']):
            self.get_logger().warning(
                f'{mismatch}: set bit_period to how long the markers hold a bit '
                f'[s], and let the sensor measure twice in that time'
            )

    def _examine(self) -> Health:
        """Tell what became of the candidates, and whether there are frames."""
        counts = self._detector.counts
        frames = self._frames - self._examined_frames
        values = {
            'method': self._values['method'],
            'frames': str(self._frames),
            'processing [ms a frame]': f'{1e3 * self._busy_s / max(frames, 1):.2f}',
            'age of frames when processed [ms]': f'{1e3 * self._age_s / max(frames, 1):.1f}',
            'candidates': str(counts.candidates),
            'accepted': str(counts.accepted),
            'impossible samples': str(counts.impossible),
            'overloads': str(counts.overloads),
        }
        self._examined_frames, self._busy_s, self._age_s = self._frames, 0.0, 0.0
        for reason, number in sorted(counts.rejected.items()):
            values[f'rejected: {reason}'] = str(number)
        now_s = time.monotonic()
        for identity in sorted({*self._known, *self._registered(self._values)}):
            read_s = self._read_s.get(identity)
            age = 'never' if read_s is None else f'{now_s - read_s:.1f}'
            values[f'since last reading of {frame_of(identity, self._known)} [s]'] = age
        silence_s = now_s - self._heard_s
        if not self._frames:
            return Health(WARN, 'no frame has come yet', values)
        if silence_s > _SILENCE_S:
            return Health(STALE, f'no frame has come for {silence_s:.0f} s', values)
        return Health(OK, f'{counts.accepted} of {counts.candidates} candidates accepted', values)


def _declare(parameters: Parameters) -> None:
    parameters.text('method', 'How markers are read.', METHODS, live=True)
    parameters.number(
        'bit_period',
        'How long a marker holds a bit: two frames [s].',
        *BIT_PERIOD_LIMITS_S,
        live=True,
    )
    parameters.number(
        'false_ids_per_hour',
        'How many false IDs may come in an hour, over all zones (joint).',
        1e-6,
        1e6,
        live=True,
    )
    parameters.integer(
        'max_packets',
        'How many packets of a repeating marker may be combined (joint).',
        1,
        MAX_PACKETS,
        live=True,
    )
    parameters.text('marker_file', 'YAML file of the known markers; empty = none.')
    parameters.flag(
        'only_registered',
        'Let only markers of the marker file come, and registered_ids.',
        live=True,
    )
    parameters.integers(
        'registered_ids', 'The only IDs that may come; [] = all.', 0, IDS - 1, live=True
    )
    parameters.number(
        'noise_floor',
        'Variance of a signal of nothing [(kcps/SPAD)^2] (joint).',
        1e-6,
        1e6,
        live=True,
    )
    parameters.number(
        'noise_slope',
        'By how much the variance grows with the signal [kcps/SPAD] (joint).',
        0.0,
        1e6,
        live=True,
    )
    parameters.number(
        'noise_ambient',
        'By how much the variance grows with the ambient light [kcps/SPAD] (joint).',
        0.0,
        1e6,
        live=True,
    )
    parameters.number(
        'likelihood_threshold', 'Least likelihood of a preamble (paper).', 1e-6, 1e6, live=True
    )
    parameters.flag('publish_tf', 'Send a transform for every detection.', live=True)
    parameters.text('child_frame', 'TF frame of a marker; {name} stands for its name.')
    parameters.number(
        'stale_after',
        'How long marker_array shows a marker after a reading [s].',
        0.1,
        3600.0,
        live=True,
    )


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(DetectorNode)
