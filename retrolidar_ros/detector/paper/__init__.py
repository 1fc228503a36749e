# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detector of RetroLiDAR §3.5, as the paper states it: what the others are measured against.

One stage a file: `samples` keeps what the zones saw, `baseline` tells their silent level,
`preamble` finds starts, `demodulation` turns samples into bits, and `detector` composes them. Its
head lists what the paper leaves open and how that is decided here. Nothing of this is shared with
the other methods but the likelihood of a preamble, which all of them report.
"""

from retrolidar_ros.detector.paper.detector import LIKELIHOOD_THRESHOLD, PaperDetector
from retrolidar_ros.detector.paper.preamble import fit_preamble

__all__ = ['LIKELIHOOD_THRESHOLD', 'PaperDetector', 'fit_preamble']
