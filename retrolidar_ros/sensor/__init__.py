# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a sensor is: frame, frame rate, clock, wire, protocols, serial source."""
