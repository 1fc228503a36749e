# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The marker: packet and code, sets of IDs, wake-up, battery, marker files."""
