# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detector of RetroLiDAR §3.5 as the paper states it: the baseline.

`samples` keeps the samples, `stages` are functions of them, and `detector` composes these. Its head
lists what the paper leaves open and how that is decided here.
"""

from retrolidar_ros.detector.paper.detector import LIKELIHOOD_THRESHOLD, PaperDetector

__all__ = ['LIKELIHOOD_THRESHOLD', 'PaperDetector']
