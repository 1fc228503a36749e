# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From frames to detections: method `joint` in the core, and the method of the paper."""

from retrolidar_ros.detector.detection import Detection, DetectorCounts
from retrolidar_ros.detector.methods import METHODS, Detector, create_detector

__all__ = ['METHODS', 'Detection', 'Detector', 'DetectorCounts', 'create_detector']
