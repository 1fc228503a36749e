# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Lines that set the paper's own values beside ours."""

from __future__ import annotations

from typing import NamedTuple

NOTHING = '–'
"""Stands where there is no value: the paper gives none, or a method has no part in it."""


class Claim(NamedTuple):
    """One line of a report's table, its values as text with their units."""

    what: str
    paper: str = NOTHING
    """The value that the paper's text gives."""
    method: str = NOTHING
    """What our implementation of the paper's method gives."""
    default: str = NOTHING
    """What our default method gives, or a model that is the same for both."""
