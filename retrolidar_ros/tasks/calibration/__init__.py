# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""From a recording to parameters: what a sensor, its light and its markers are like.

`timing` is of the frames, `noise` of zones at rest, `markers` of what blinks; `calibrate` puts them
together, and `report` writes what was found. Only what changes readings or their ranges is
estimated, each with a standard deviation, and nothing that a recording does not show.
"""
