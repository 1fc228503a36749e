# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detector of RetroLiDAR §3.5 as the paper states it: the baseline."""

from retrolidar_ros.detector.paper.detector import LIKELIHOOD_THRESHOLD, PaperDetector

__all__ = ['LIKELIHOOD_THRESHOLD', 'PaperDetector']
