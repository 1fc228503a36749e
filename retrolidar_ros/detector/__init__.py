# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames in, detections out.

The default method decides in the core: `likelihood_detector` feeds it and names why a packet is
rejected, `budget` sets its thresholds. The core says where a marker is, too; `placement` makes a
detection of that, and `place` gives the pose. The paper's method is in `paper`.
"""

from retrolidar_ros.detector.detection import Detection, Detector, DetectorCounts
from retrolidar_ros.detector.methods import METHODS, create_detector

__all__ = ['METHODS', 'Detection', 'Detector', 'DetectorCounts', 'create_detector']
