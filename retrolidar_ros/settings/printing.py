# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Text from files and messages, made fit for a terminal."""

_MAX_CHARACTERS = 1000


def printable(text: str) -> str:
    """Return a text without control characters but newlines, and cut in its middle if need be."""
    if len(text) > _MAX_CHARACTERS:
        half = _MAX_CHARACTERS // 2
        text = f'{text[:half]} [... {len(text) - 2 * half} characters ...] {text[-half:]}'
    return ''.join(
        one if one.isprintable() or one == '\n' else one.encode('unicode_escape').decode()
        for one in text
    )
