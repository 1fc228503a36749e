# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks of markers at rest as readings that are independent of each other."""

from __future__ import annotations

import math
from collections.abc import Hashable

FIRST_S = 1.0
"""Time at rest before a track is taken first."""
NEW = math.sqrt(2.0)
"""Standard deviation of the new half of a track's frames, over that of the track."""
_REST_M_S = 0.02  # a marker that is slower is at rest


class Resting:
    """Chooses the frames at which a track is taken as a reading, so that readings are independent.

    The range of a marker at rest is a mean over all its frames so far, so tracks of successive
    frames have the same errors. When twice as many frames are in it as the last time, half of them
    are new, and their own mean has twice the variance. So a track is taken after 1, 2, 4, 8 s ...
    of rest.
    """

    def __init__(self) -> None:
        """Begin without any track."""
        self._due: dict[Hashable, tuple[float, float]] = {}

    def is_due(self, track: Hashable, stamp_s: float, first_s: float, speed_m_s: float) -> bool:
        """Return whether a frame of a track is to be taken as a reading.

        Parameters
        ----------
        track
            What identifies sensor and marker.
        stamp_s, first_s
            Time of the frame, and of the first packet of the track [s].
        speed_m_s
            Of the marker.
        """
        since_s, due_s = self._due.get(track, (first_s, FIRST_S))
        if not speed_m_s < _REST_M_S or stamp_s < since_s:
            since_s, due_s = stamp_s, FIRST_S
        elif first_s > since_s:
            since_s, due_s = first_s, FIRST_S
        age_s = stamp_s - since_s
        is_due = age_s >= due_s
        self._due[track] = since_s, 2 * age_s if is_due else due_s
        return is_due
