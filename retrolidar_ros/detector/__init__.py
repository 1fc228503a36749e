# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames in, detections out: one stage a file.

The paper's method is in `paper`. Of the others, `window` keeps the samples with their times and
weights, `view` some zones of it, `activity` picks those that may hold a packet, `soft_bits` cuts
them into bits, `starts` finds preambles ahead, `words` holds packets against soft bits, `search`
and `fold` name `candidates`, `fit` fits them with the exact `template`, `companions` adds zones
that see the same, `judge` tests them by their `evidence`, `rivals` and `coherence`, `placement`
places what was read by its `ranging` and `bearing`, `report` makes detections, and
`evidence_detector` composes all of this, within its `budget` of false IDs. `place` gives the pose,
for both.
"""

from retrolidar_ros.detector.detection import Detection, Detector, DetectorCounts
from retrolidar_ros.detector.methods import METHODS, create_detector

__all__ = ['METHODS', 'Detection', 'Detector', 'DetectorCounts', 'create_detector']
