# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detector of RetroLiDAR §3.5 as the paper states it: the baseline.

One stage a file: `samples` keeps the samples, `baseline` estimates the silent level, `preamble`
finds starts, `demodulation` turns samples into bits, and `detector` composes them. Its head lists
what the paper leaves open and how that is decided here.
"""

from retrolidar_ros.detector.paper.detector import LIKELIHOOD_THRESHOLD, PaperDetector

__all__ = ['LIKELIHOOD_THRESHOLD', 'PaperDetector']
