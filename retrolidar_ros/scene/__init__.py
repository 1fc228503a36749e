# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The smallest model of marker, sensor and room that a scene asks for.

`description` reads it from a file, `transmission` is what a liquid crystal lets through, `optics`
how much of it reaches which zone, `laboratory` what else happens, `simulation` what is reported.
"""

from retrolidar_ros.scene.description import Scene, parse_scene
from retrolidar_ros.scene.simulation import Simulation

__all__ = ['Scene', 'Simulation', 'parse_scene']
