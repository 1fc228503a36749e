# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `detector` node: from `frames` to `markers` and TF."""

from __future__ import annotations

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

from retrolidar_ros.detector import METHODS, Detector, create_detector
from retrolidar_ros.frame import ZoneGrid
from retrolidar_ros.msg import Frame as FrameMsg
from retrolidar_ros.msg import MarkerDetection
from retrolidar_ros.nodes.conversion import from_frame_msg, to_detection_msg, to_transform
from retrolidar_ros.nodes.parameters import Parameters
from retrolidar_ros.nodes.run import run
from retrolidar_ros.nodes.transforms import transform_sender


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
        self._likelihood_threshold = parameters.number(
            'likelihood_threshold', 'Least likelihood of a preamble.', 1e-6, 1e6
        )
        self._detector: Detector | None = None
        self._grid = ZoneGrid()
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
        if self._detector is None or frame.grid != self._grid:
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

    def _new_detector(self, grid: ZoneGrid) -> Detector:
        return create_detector(
            self._method,
            grid,
            bit_period_s=self._bit_period,
            likelihood_threshold=self._likelihood_threshold,
        )


def main() -> int:
    """Run the node; return the exit code of the process."""
    return run(DetectorNode)
