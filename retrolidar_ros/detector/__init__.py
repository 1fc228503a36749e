# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames in, detections out: one stage a file.

`samples` keeps what the zones saw, `baseline` their silent level, `preamble` finds starts,
`demodulation` turns samples into bits, `place` gives the pose, and `paper` composes them.
"""

from retrolidar_ros.detector.detection import Detection, Detector, DetectorCounts
from retrolidar_ros.detector.methods import METHODS, create_detector

__all__ = ['METHODS', 'Detection', 'Detector', 'DetectorCounts', 'create_detector']
