# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames in, detections out.

The default method lives in the core: `likelihood_detector` feeds it, `budget` says what it demands
of a packet, `reason` why one is refused. It says where what was read is, too; `placement` makes a
detection of that, and `place` the pose. The paper's method is in `paper`.
"""

from retrolidar_ros.detector.detection import Detection, Detector, DetectorCounts
from retrolidar_ros.detector.methods import METHODS, create_detector

__all__ = ['METHODS', 'Detection', 'Detector', 'DetectorCounts', 'create_detector']
