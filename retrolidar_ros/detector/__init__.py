# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames in, detections out: the core decides; the method of the paper is the baseline."""

from retrolidar_ros.detector.detection import Detection, Detector, DetectorCounts
from retrolidar_ros.detector.methods import METHODS, create_detector

__all__ = ['METHODS', 'Detection', 'Detector', 'DetectorCounts', 'create_detector']
