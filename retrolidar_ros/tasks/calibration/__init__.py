# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a recording to parameters with standard deviations: noise, bit period, range offset."""
