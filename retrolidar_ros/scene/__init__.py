# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulate a sensor that sees markers, as a scene file describes.

`description` reads the file; `transmission` is the light that a liquid crystal lets through;
`optics` says which zones it reaches, and adds disturbances; `simulation` makes the frames.
"""

from retrolidar_ros.scene.description import Scene, parse_scene
from retrolidar_ros.scene.simulation import Simulation

__all__ = ['Scene', 'Simulation', 'parse_scene']
