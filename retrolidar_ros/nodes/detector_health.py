# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The counters of a detector, and its health over the last second."""

import time

from retrolidar_ros.detector import Detection, DetectorCounts
from retrolidar_ros.detector.frame_monitor import FrameMonitor
from retrolidar_ros.detector.parameters import DetectorSettings
from retrolidar_ros.marker.known_markers import frame_of
from retrolidar_ros.nodes.diagnostics import ERROR, PERIOD_S, STALE, WARN, Health
from retrolidar_ros.sensor.frame import ZoneGrid, stamps_stand

_SILENCE_S = 2.0
_MIXED = 2  # a sensor that restarts resets its counter once
_OVERLOADED = 3  # of about six searches a second; a single one does no harm
NO_FRAME = 'no frame has come'


class DetectorHealth:
    """Counts frames and detections."""

    def __init__(self, grid: ZoneGrid) -> None:
        self.monitor = FrameMonitor(grid)
        self.foreign = 0  # frames from another TF frame than the one before
        self._dropped = 0
        self._reason = ''
        self._frame_s = self._examined_s = time.monotonic()
        self._busy_s = self._age_s = 0.0
        self._stamp_ns = self._examined_ns = 0
        self._read_s: dict[int, float] = {}
        self._then = self._counts(DetectorCounts())

    def restart(self, grid: ZoneGrid) -> None:
        """Restart watching; the counts go on, except those of the detector."""
        self.monitor.restart(grid)
        self._then['overloads'] = 0

    def drop(self, reason: str) -> None:
        """Count an unusable frame."""
        self._dropped += 1
        self._reason = reason

    def done(self, stamp_ns: int, busy_s: float, age_s: float) -> None:
        """Count the processing time of a frame, and its age."""
        self._stamp_ns = stamp_ns
        self._frame_s = time.monotonic()
        self._busy_s += busy_s
        self._age_s += age_s

    def read(self, detections: list[Detection]) -> None:
        """Count detections."""
        self.monitor.read(detections)
        for detection in detections:
            self._read_s[detection.id] = time.monotonic()

    def _counts(self, counts: DetectorCounts) -> dict[str, int]:
        return {
            'frames': self.monitor.frames,
            'lost frames': self.monitor.lost,
            'frames not sent': self.monitor.unsent,
            'repeated frames': self.monitor.repeated,
            'frames out of order': self.monitor.reversed,
            'frames of another sensor': self.foreign,
            'dropped frames': self._dropped,
            'overloads': counts.overloads,
        }

    def examine(
        self, settings: DetectorSettings, counts: DetectorCounts, publishers: list[str]
    ) -> Health:
        """Judge the time since the last call."""
        now = self._counts(counts)
        new = {name: number - self._then[name] for name, number in now.items()}
        self._then = now
        advance_ns, self._examined_ns = self._stamp_ns - self._examined_ns, self._stamp_ns
        frames = max(new['frames'], 1)
        values = {
            'method': settings.values['method'],
            'processing [ms a frame]': f'{1e3 * self._busy_s / frames:.2f}',
            'age of frames when processed [ms]': f'{1e3 * self._age_s / frames:.1f}',
            'publishers of frames': str(len(publishers)),
            'candidates': str(counts.candidates),
            'accepted': str(counts.accepted),
            'impossible samples': str(counts.impossible),
            **{name: str(number) for name, number in now.items()},
            **{f'rejected: {name}': str(one) for name, one in sorted(counts.rejected.items())},
        }
        self._busy_s = self._age_s = 0.0
        now_s = time.monotonic()
        for identity in sorted({*settings.known, *settings.registered}):
            read_s = self._read_s.get(identity)
            age = 'never' if read_s is None else f'{now_s - read_s:.1f}'
            values[f'since last reading of {frame_of(identity, settings.known)} [s]'] = age
        # While this process was suspended, it received nothing.
        self._frame_s += max(now_s - self._examined_s - PERIOD_S, 0.0)
        self._examined_s, silence_s = now_s, now_s - self._frame_s
        if not now['frames'] and not new['dropped frames']:
            return Health([(WARN, f'{NO_FRAME} yet')], values)
        if silence_s > _SILENCE_S and not new['dropped frames']:
            return Health([(STALE, f'{NO_FRAME} for {silence_s:.0f} s')], values)
        problems = self._disturbances(new, publishers)
        unread = self.monitor.unread(settings)
        if stamps_stand(new['frames'] - new['repeated frames'], advance_ns):
            problems.append((ERROR, 'the stamps of frames stand still: has /clock stopped?'))
        elif rate := self.monitor.rate(settings.values['bit_period']):
            problems.append((WARN, str(rate)))
        if unread:
            problems.append((WARN, str(unread)))
        rejected = sum(counts.rejected.values())
        return Health(problems, values, f'{counts.accepted} packets accepted, {rejected} rejected')

    def _disturbances(self, new: dict[str, int], publishers: list[str]) -> list[tuple[bytes, str]]:
        problems = []
        names = ('frames of another sensor', 'frames out of order', 'repeated frames')
        mixed = {name: new[name] for name in names if new[name]}
        if sum(mixed.values()) >= _MIXED:
            by = f' by {", ".join(sorted(publishers))}' if len(publishers) > 1 else ''
            how = ', '.join(f'{count} {name}' for name, count in mixed.items())
            text = f'frames of several sensors come mixed{by}: {how}; one detector reads one sensor'
            problems.append((ERROR, text))
        elif lost := new['lost frames']:
            text = (
                f'{lost} frames were lost between driver and detector, {self.monitor.lost} in all'
            )
            problems.append((WARN, f'{text}: this host is too slow, or the network'))
        elif unsent := new['frames not sent']:
            text = f'{unsent} frames were not sent: lost before the driver, or it was not active'
            problems.append((WARN, text))
        if dropped := new['dropped frames']:
            problems.append((ERROR, f'{dropped} frames cannot be used: {self._reason}'))
        if (overloads := new['overloads']) >= _OVERLOADED:
            text = f'search overloaded in {overloads} frames: more candidates than the limit'
            problems.append((WARN, f'{text}; reduce max_packets'))
        return problems
