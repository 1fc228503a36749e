# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether frames come as a detector needs them, and whether blinking zones are read."""

from collections import deque
from collections.abc import Iterator

import numpy as np

from retrolidar_ros.core import lib
from retrolidar_ros.detector.blinking_zones import modulation_db
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.explain import Explanation, rate_finding
from retrolidar_ros.detector.findings import Cause, Finding
from retrolidar_ros.detector.parameters import DetectorSettings
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid, frame_period, missing_frames

_KEPT = 320  # a packet with nine frames a bit
_MIN_KEPT = 128
_CLEARLY_DB = 6.0  # below this, something that moves far away, or noise, may be the cause
# For so long a zone may blink unread by other bits, and for so many packets by the right ones: a
# detector combines eight.
_PATIENCE_S = 1.5
_RATE_FRAMES = 33  # whose median interval is taken for the frame period
_LATE_NS = int(lib.RL_MAX_LATE_NS)
_PAUSE_NS = 1_000_000_000  # without frames: what came before it is left out
_PACKETS = 9
_REMEMBERED_NS = 10_000_000_000
_LOOKING_S = (0.9, 2.0)  # between the first looks, and later: one costs up to tens of milliseconds
_HASTY = 9  # first looks at a zone


class FrameMonitor:
    """Counts frames, and looks for blinking zones that are not read in the newest."""

    def __init__(self, grid: ZoneGrid) -> None:
        self.frames = 0
        self.lost = 0  # frames that were sent, by the sequence counter, and never came
        self.unsent = 0  # frames that the node before this one did not send
        self.repeated = 0  # frames that came a second time, and were left out
        # Frames that were overtaken, or whose counter went back: a sensor restarted, or are two.
        self.reversed = 0
        self.newest: deque[Frame] = deque(maxlen=_KEPT)
        self.restart(grid)

    def restart(self, grid: ZoneGrid) -> None:
        """Forget the newest frames, not the counts; the next ones may have another grid."""
        self.newest.clear()
        self._near = grid.near
        self._explained_ns = np.zeros(grid.zones, dtype=np.int64)
        self._looked_ns = self._looks = 0
        self._zone: int | None = None  # the zone that blinks and is not read,
        self._why: Iterator[Finding | None] = iter(())  # its trials to come,
        self._found: Finding | None = None  # what they have found,
        self._until_ns = 0  # until when that holds, even if the zone is read now and then,
        self._finding: Finding | None = None  # and what is told of it

    def take(self, frame: Frame, max_lost: int | None = None) -> bool:
        """Count a frame, before which `max_lost` at most got lost; return whether it is new."""
        self.frames += 1
        if self.newest:
            last = self.newest[-1]
            if (frame.sequence, frame.stamp_ns) == (last.sequence, last.stamp_ns):
                self.repeated += 1
                return False
            step_ns = frame.stamp_ns - last.stamp_ns
            if -_LATE_NS <= step_ns < 0:
                self.reversed += 1
                return False
            missing = missing_frames(last.sequence, frame.sequence)
            lost = missing if max_lost is None else min(missing, max_lost)
            self.lost += lost
            self.unsent += missing - lost
            self.reversed += frame.sequence < last.sequence
            if not 0 <= step_ns <= _PAUSE_NS:
                self.restart(frame.grid)  # as a detector does
        if not self.newest:
            self._explained_ns[:] = frame.stamp_ns
        self.newest.append(frame)
        return True

    def read(self, detections: list[Detection]) -> None:
        """Note detections: they explain why their zones and those beside them blink."""
        for detection in detections:
            for zone in detection.zones:
                self._explained_ns[self._near[zone]] = detection.end_ns

    def rate(self, bit_period_s: float) -> Finding | None:
        """Return that a bit does not last one to eight of the newest frames, if it does not."""
        if len(self.newest) < _RATE_FRAMES:
            return None
        frame_s = frame_period(Recording.of(list(self.newest)[-_RATE_FRAMES:]))
        return rate_finding(frame_s, bit_period_s) if frame_s > 0 else None  # or clocks stand still

    def unread(self, settings: DetectorSettings) -> Finding | None:
        """Return why a zone blinks by a clock unread; each call may try one bit period."""
        if len(self.newest) < _MIN_KEPT:
            return None
        now_ns = self.newest[-1].stamp_ns
        if now_ns - self._looked_ns >= 1e9 * _LOOKING_S[self._looks >= _HASTY]:
            self._looked_ns = now_ns
            self._look(now_ns, settings)
        return self._finding

    def _look(self, now_ns: int, settings: DetectorSettings) -> None:
        """Look for a zone that waits for too long, or try one more bit period in that zone."""
        recording = Recording.of(list(self.newest))
        law = settings.noise.lit(recording.ambient)
        quiet = ~(modulation_db(recording, law) >= _CLEARLY_DB)
        self._explained_ns[quiet] = now_ns
        waited_s = (now_ns - self._explained_ns) * 1e-9
        if self._zone is not None and waited_s[self._zone] >= _PATIENCE_S:
            self._until_ns = now_ns + _REMEMBERED_NS
        elif self._until_ns < now_ns:
            self._zone, self._found, self._finding, self._looks = None, None, None, 0
        if self._zone is None:
            if waited_s.max() < _PATIENCE_S:
                return
            explanation = Explanation(recording, settings)
            waiting = (one for one in explanation.zones if waited_s[one.zone] >= _PATIENCE_S)
            zone = next((one for one in waiting if one.is_clocked), None)
            if zone is None:
                return
            self._zone, self._why = zone.zone, explanation.why(zone)
            self._until_ns = now_ns + _REMEMBERED_NS
        self._looks += 1
        self._found = next(self._why, self._found)
        has_remedy = self._found is not None and self._found.cause is Cause.BIT_PERIOD
        is_missed = waited_s[self._zone] >= _PACKETS * PACKET_BITS * settings.values['bit_period']
        is_expected = not settings.registered
        self._finding = self._found if has_remedy or (is_missed and is_expected) else None
