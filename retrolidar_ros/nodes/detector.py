# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `detector` node: from `frames` to `markers` and TF."""

from __future__ import annotations

import time
from functools import partial

import numpy as np
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from retrolidar_ros.code import IDS
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.detector.evidence import NoiseLaw
from retrolidar_ros.detector.methods import MAX_PACKETS
from retrolidar_ros.frame import ZoneGrid
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import from_frame_msg, to_detection_msg, to_transform
from retrolidar_ros.nodes.diagnostics import OK, WARN, Health, publish_health
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.run import run
from retrolidar_ros.nodes.transforms import transform_sender

# Frames that tell how fast they come, by the median of the times between them: a few may be lost.
_RATE_FRAMES = 33
_MOST_RATE_ERROR = 0.1
_SILENCE_S = 2.0


class DetectorNode(Node):
    """Publishes every marker that is read, as a message and as a transform."""

    def __init__(self) -> None:
        """Declare parameters and subscribe."""
        super().__init__('detector')
        parameters = Parameters(self, 'detector')
        self._method = parameters.text('method', 'How markers are read.', METHODS)
        self._bit_period = parameters.number(
            'bit_period', 'How long a marker holds a bit: two frames [s].', 0.002, 10.0
        )
        registered_ids = parameters.integers(
            'registered_ids',
            'The only IDs that may come; empty = all (all but paper).',
            0,
            IDS - 1,
        )
        self._new_detector = partial(
            create_detector,
            self._method,
            bit_period_s=self._bit_period,
            likelihood_threshold=parameters.number(
                'likelihood_threshold', 'Least likelihood of a preamble (paper).', 1e-6, 1e6
            ),
            false_ids_per_hour=parameters.number(
                'false_ids_per_hour',
                'How many IDs noise alone may make in an hour, over all zones (all but paper).',
                1e-6,
                1e6,
            ),
            max_packets=parameters.integer(
                'max_packets',
                'How many packets of a repeating marker may be combined (joint).',
                1,
                MAX_PACKETS,
            ),
            registered_ids=registered_ids or None,
            noise=NoiseLaw(
                parameters.number(
                    'noise_floor',
                    'Variance of a signal of nothing [(kcps/SPAD)^2] (all but paper).',
                    1e-6,
                    1e6,
                ),
                parameters.number(
                    'noise_slope',
                    'By how much the variance grows with the signal [kcps/SPAD] (all but paper).',
                    0.0,
                    1e6,
                ),
            ),
        )
        # The zones are known with the first frame, but what cannot be is to be said at the start.
        self._grid = ZoneGrid()
        self._detector = self._new_detector(self._grid)
        self._frames = 0
        self._heard_s = time.monotonic()
        self._first_stamps_ns: list[int] = []
        self._publisher = self.create_publisher(
            MarkerDetection,
            'markers',
            QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE),
        )
        self._send_transforms = (
            transform_sender(self)
            if parameters.flag('publish_tf', 'Send a transform for every detection.')
            else None
        )
        parameters.warn_of_unknown()
        self.get_logger().info(f'reading markers by method {self._method}')
        publish_health(self, 'markers', '', self._examine)
        self.create_subscription(
            FrameMsg,
            'frames',
            self._detect,
            QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT),
        )

    def _detect(self, message: FrameMsg) -> None:
        try:
            if not message.header.frame_id:
                raise ValueError('its frame_id is empty')
            frame = from_frame_msg(message)
        except ValueError as error:
            self.get_logger().error(f'frame dropped: {error}', throttle_duration_sec=5.0)
            return
        self._frames += 1
        self._heard_s = time.monotonic()
        self._check_rate(frame.stamp_ns)
        if frame.grid != self._grid:
            self._grid = frame.grid
            self._detector = self._new_detector(frame.grid)
        detections = [
            to_detection_msg(detection, message.header.frame_id, f'marker_{detection.id}')
            for detection in self._detector.update(frame)
        ]
        for detection in detections:
            self._publisher.publish(detection)
        if detections and self._send_transforms is not None:
            self._send_transforms([to_transform(detection) for detection in detections])

    def _check_rate(self, stamp_ns: int) -> None:
        """Warn once if a bit does not last two frames, as all methods suppose."""
        if len(self._first_stamps_ns) == _RATE_FRAMES:
            return
        self._first_stamps_ns.append(stamp_ns)
        if len(self._first_stamps_ns) < _RATE_FRAMES:
            return
        period_s = float(np.median(np.diff(self._first_stamps_ns))) * 1e-9
        expected_s = self._bit_period / 2
        if abs(period_s - expected_s) > _MOST_RATE_ERROR * expected_s:
            self.get_logger().warning(
                f'a frame comes every {period_s * 1e3:.1f} ms, but half of bit_period is '
                f'{expected_s * 1e3:.1f} ms: set bit_period to how long the markers hold a bit '
                f'[s], and let the sensor measure twice in that time'
            )

    def _examine(self) -> Health:
        """Tell what became of the candidates, and whether there are frames."""
        counts = self._detector.counts
        values = {
            'method': self._method,
            'frames': str(self._frames),
            'candidates': str(counts.candidates),
            'accepted': str(counts.accepted),
        }
        for reason, number in sorted(counts.rejected.items()):
            values[f'rejected: {reason}'] = str(number)
        silence_s = time.monotonic() - self._heard_s
        if not self._frames:
            return Health(WARN, 'no frame has come yet', values)
        if silence_s > _SILENCE_S:
            return Health(WARN, f'no frame has come for {silence_s:.0f} s', values)
        return Health(OK, f'{counts.accepted} of {counts.candidates} candidates accepted', values)


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(DetectorNode)
