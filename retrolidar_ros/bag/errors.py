# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors of bags."""

from __future__ import annotations

INSTALL = 'pip install rosbags'


class BagError(ValueError):
    """A bag cannot be written, or cannot be read, or not to its end."""


class DamageError(Exception):
    """A file is damaged; the frames before the damage are good."""
