# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a recording to parameters: what a sensor, its light and its markers are like.

`timing` is of the frames, `noise` of zones at rest, `crystal` of what blinks, `sweep` of a marker
that crosses the view; `calibrate` puts them together, and `files` writes what was found. Each
estimate has a standard deviation, and what a recording does not show is not estimated.
"""
