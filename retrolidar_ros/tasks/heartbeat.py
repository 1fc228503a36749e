# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Detections of one marker as heartbeats: the share of time windows with one (paper §7.2)."""

import math

WINDOW_S = 10.0  # of the paper's detection rate
_MAX_WINDOWS = 100  # a larger jump of time is a clock that was set
_JITTER_S = 1.0  # by which time may go back; by more, it was set back


class Heartbeat:
    """Counts windows with and without a detection, and the longest silence, by given times."""

    def __init__(self, window_s: float = WINDOW_S) -> None:
        self.window_s = window_s
        self._begin(math.inf)  # any time is before that, so the count begins again

    def _begin(self, time_s: float) -> None:
        self.beats = 0
        self.windows = 0  # complete windows
        self.windows_alive = 0  # windows with at least one detection
        self._window_start_s = self._last_s = self._newest_s = time_s
        self._longest_s = 0.0
        self._beats_in_window = 0

    def beat(self, time_s: float, unseen_s: float = 0.0) -> None:
        """Take a detection, or a track whose light was last seen `unseen_s` before [s]."""
        self.advance(time_s)
        seen_s = time_s - unseen_s
        if unseen_s and seen_s <= self._last_s:  # its light has been counted
            return
        self._longest_s = max(self._longest_s, seen_s - self._last_s)
        self._last_s = max(self._last_s, seen_s)
        self._beats_in_window += seen_s >= self._window_start_s
        self.beats += 1

    def advance(self, time_s: float) -> None:
        """Let time pass; a jump, as of a replay or a clock that is set, starts the count again."""
        if time_s < max(self._window_start_s, self._newest_s - _JITTER_S):
            self._begin(time_s)
        self._newest_s = max(self._newest_s, time_s)
        passed = math.floor((time_s - self._window_start_s) / self.window_s)
        if passed > _MAX_WINDOWS:
            self._begin(time_s)
        elif passed:
            self._window_start_s += passed * self.window_s
            self.windows += passed
            self.windows_alive += self._beats_in_window > 0
            self._beats_in_window = 0

    def silence_s(self, time_s: float) -> float:
        """Return the time since the last detection, or since the count began [s]."""
        return max(time_s - self._last_s, 0.0)

    def longest_silence_s(self, time_s: float) -> float:
        """Return the longest time without a detection, the present silence included [s]."""
        return max(self._longest_s, self.silence_s(time_s))
