# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sensor: frames, frame rate, clock and stamps, wire protocols, serial port."""
