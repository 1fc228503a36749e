# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What detections are for: objects, landmarks, localisation, heartbeat, calibration."""
