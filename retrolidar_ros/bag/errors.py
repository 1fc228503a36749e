# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What goes wrong with bags."""

from __future__ import annotations

INSTALL = 'pip install rosbags'


class BagError(ValueError):
    """A bag cannot be written, or cannot be read, or not to its end."""


class DamageError(Exception):
    """From here on a file cannot be read; the frames before are good."""
