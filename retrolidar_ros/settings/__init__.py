# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML files, units and checks, shipped files, termination signals."""
