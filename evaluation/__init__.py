# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The experiments and their charts: every one writes NAME.json and NAME.png."""
