# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The experiments and their charts: every one writes NAME.json and NAME.png."""

from retrolidar_ros.evaluation.experiments import EXPERIMENTS, run_experiments
from retrolidar_ros.evaluation.page import write_page

__all__ = ['EXPERIMENTS', 'run_experiments', 'write_page']
