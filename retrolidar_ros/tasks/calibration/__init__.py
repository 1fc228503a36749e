# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a recording to parameters: noise, bit period and range offset.

`noise` is of zones at rest, `markers` of what blinks; `calibrate` puts them together, and `report`
writes what was found. Each estimate has a standard deviation; what a recording does not show is not
estimated.
"""
