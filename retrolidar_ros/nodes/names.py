# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Names derived from other names."""

from __future__ import annotations

import re


def topic_part(frame: str) -> str:
    """Return a TF frame as a part of a topic's name, which takes fewer characters."""
    part = re.sub(r'\W', '_', frame, flags=re.ASCII)
    return f'_{part}' if part[0].isdigit() else part
