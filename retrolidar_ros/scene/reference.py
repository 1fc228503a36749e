# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sensor (a VL53L8CX), wall (the paper's) and liquid crystal of budgets and experiments."""

from retrolidar_ros.scene.description import Noise, Ranging, Response, Sensor
from retrolidar_ros.sensor.model import VL53L8CX

WALL_SIGNAL = 4.0  # [kcps/SPAD] (paper §3.2)
NOISE = Noise(floor=VL53L8CX.noise.floor, slope=VL53L8CX.noise.slope)
RANGING = Ranging(shot=VL53L8CX.ranging_shot, floor=VL53L8CX.ranging_floor_m)
SENSOR = Sensor(noise=NOISE, ranging=RANGING)
RESPONSE = Response(dark_s=0.0005, bright_s=0.0035)
