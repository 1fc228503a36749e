# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a marker is: code, dictionary, liquid crystal, wake-up, battery, the known ones."""
