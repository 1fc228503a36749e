# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Names that are made of other names, and where they hold."""

from __future__ import annotations

import re


def topic_part(frame: str) -> str:
    """Return a TF frame as a part of a topic's name, which takes fewer characters."""
    part = re.sub(r'\W', '_', frame, flags=re.ASCII)
    return f'_{part}' if part[0].isdigit() else part


def in_namespace(namespace: str) -> list[str]:
    """Return a node's own arguments for a namespace, which go before those of the process.

    Empty for that of the process. The namespace that a node's code gives does not: `__ns` on the
    command line overrides it.
    """
    return ['--ros-args', '-r', f'__ns:={namespace}'] if namespace else []
