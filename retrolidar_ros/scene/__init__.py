# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The smallest model of marker, sensor and room that a scene asks for.

`description` says what a scene may name, `transmission` what a marker's liquid crystal lets
through, `optics` how much of it reaches which zone, `noise` what the sensor adds to it, and
`simulation` what the sensor reports.
"""

from retrolidar_ros.scene.description import Scene, parse_scene
from retrolidar_ros.scene.simulation import Simulation

__all__ = ['Scene', 'Simulation', 'parse_scene']
