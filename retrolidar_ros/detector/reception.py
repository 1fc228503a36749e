# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether frames come as a detector needs them, and whether what blinks in them is read."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from retrolidar_ros.detector.blinking import Samples, modulation_db
from retrolidar_ros.detector.blinking_zones import bit_periods
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.explain import period_finding, rate_findings
from retrolidar_ros.detector.findings import Cause, Finding, finding, named_periods
from retrolidar_ros.detector.parameters import detector_of, noise_of, registered
from retrolidar_ros.detector.rejections import adjacency
from retrolidar_ros.detector.trials import Trial, best, candidates, trials
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.marker.known_markers import KnownMarker
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.frame_rate import RATE_FRAMES, frame_period, missing_frames

_KEPT = 320  # a packet of nine frames a bit
_LEAST_KEPT = 128
# A zone that varies by less may do so by something that moves far away, or by noise.
_CLEARLY_DB = 6.0
# Lines of a spectrum that are no chance.
_CLOCKED = 12.0
# For so long a zone may blink unread by other bits, and for so many packets by the right ones: a
# detector combines eight.
_PATIENCE_S = 4.0
_PACKETS = 9
_REMEMBERED_NS = 10_000_000_000
_LOOKING_S = 0.9  # a look costs milliseconds, with a trial tens of them
_LONG_LOOKING_S = 2.0  # between trials when those that are likely have read nothing


class _Search:
    """Bit periods that are tried one after the other for a zone that blinks unread."""

    def __init__(self, zone: int, blinks_db: float, likely_s: list[float]) -> None:
        self.zone = zone
        self.blinks_db = blinks_db
        self.likely_s = likely_s
        self.trials: list[Trial] = []
        """What they read in the zone."""
        self.finding: Finding | None = None
        """That one reads it."""
        self.until_ns = 0
        """So long it is of interest, though the zone is read now and then."""

    @property
    def is_hasty(self) -> bool:
        """Whether likely bit periods wait for their trial."""
        return len(self.trials) < len(self.likely_s)


class Reception:
    """Counts frames, and watches the newest of them for what blinks without being read."""

    def __init__(self, grid: ZoneGrid) -> None:
        """Begin with no frame of `grid`."""
        self.frames = 0
        self.lost = 0
        """Frames that the sequence counter says were sent, and that never came."""
        self.repeated = 0
        """Frames that came a second time, and were left out."""
        self.reversed = 0
        """Frames with a counter before the last one: a sensor restarted, or there are two."""
        self.newest: deque[Frame] = deque(maxlen=_KEPT)
        self.restart(grid)

    def restart(self, grid: ZoneGrid) -> None:
        """Forget the newest frames, not the counts: others follow, of another grid maybe."""
        self.newest.clear()
        self._near = adjacency(grid)
        self._explained_ns = np.zeros(grid.zones, dtype=np.int64)
        self._looked_ns = 0
        self._finding: Finding | None = None
        self._search: _Search | None = None

    def take(self, frame: Frame) -> bool:
        """Count a frame; return whether it is a new one."""
        self.frames += 1
        if self.newest:
            last = self.newest[-1]
            if (frame.sequence, frame.stamp_ns) == (last.sequence, last.stamp_ns):
                self.repeated += 1
                return False
            self.lost += missing_frames(last.sequence, frame.sequence)
            self.reversed += frame.sequence < last.sequence
        else:
            self._explained_ns[:] = frame.stamp_ns
        self.newest.append(frame)
        return True

    def read(self, detections: list[Detection]) -> None:
        """Take note of what was read, which explains why its zones and those beside them blink."""
        for detection in detections:
            for zone in detection.zones:
                self._explained_ns[self._near[zone]] = detection.end_ns

    def rate(self, bit_period_s: float) -> Finding | None:
        """Return that a bit does not last one to eight of the newest frames, if it does not."""
        newest = list(self.newest)[-RATE_FRAMES:]
        if len(newest) < RATE_FRAMES:
            return None
        # By either clock: stamps of frames that come late, all at once, are too near to each other.
        steps = [
            max(
                after.stamp_ns - before.stamp_ns,
                1000 * (after.sensor_time_us - before.sensor_time_us),
            )
            / (1 + missing_frames(before.sequence, after.sequence))
            for before, after in pairwise(newest)
        ]
        # As if none had been lost, whose gaps would make the frames look slow.
        return next(iter(rate_findings(float(np.median(steps)) * 1e-9, bit_period_s)), None)

    def unread(self, values: Mapping[str, Any], known: Mapping[int, KnownMarker]) -> Finding | None:
        """Return why a zone blinks by a clock and is not read, as far as is known by now.

        Each call may try one bit period, where the markers may come that a detector of `values`
        reads.
        """
        if len(self.newest) < _LEAST_KEPT:
            return None
        now_ns = self.newest[-1].stamp_ns
        hasty = self._search is None or self._search.is_hasty
        wait_s = _LOOKING_S if hasty else _LONG_LOOKING_S
        if abs(now_ns - self._looked_ns) >= wait_s * 1e9:
            self._looked_ns = now_ns
            self._finding = self._look(now_ns, values, known)
        return self._finding

    def _look(
        self, now_ns: int, values: Mapping[str, Any], known: Mapping[int, KnownMarker]
    ) -> Finding | None:
        """Return why the zone that has waited for long enough is not read; try one more period."""
        recording = Recording.of(list(self.newest))
        samples = Samples.of(recording)
        blinking = modulation_db(samples, noise_of(values).lit(recording.ambient))
        # Stamps may go back, where a bag is played again.
        quiet = ~(blinking >= _CLEARLY_DB) | (self._explained_ns > now_ns)
        self._explained_ns[quiet] = now_ns
        waited_s = (now_ns - self._explained_ns) * 1e-9
        bit_s, search = values['bit_period'], self._search
        if search and waited_s[search.zone] >= _PATIENCE_S:
            search.until_ns = now_ns + _REMEMBERED_NS
        elif search is None or search.finding is None or now_ns > search.until_ns:
            search = self._search = self._begun(recording, samples, blinking, waited_s)
        if search is None:
            return None
        if search.finding:
            return search.finding

        def read(recording: Recording, bit_s: float) -> list[Detection]:
            detector = detector_of({**values, 'bit_period': bit_s}, recording.grid, known)
            return detector.update_all(recording)

        tried_s = [bit_s, *(one.tried_s for one in search.trials)]
        if trial := next(trials(recording, search.likely_s, read, tried_s), None):
            search.trials.append(trial.within(search.zone))
        found = best(search.trials)
        if found and (found.is_sure(recording) or not search.is_hasty):
            search.finding = period_finding(search.zone, search.blinks_db, found, bit_s)
            return search.finding
        patience_s = _PACKETS * PACKET_BITS * bit_s
        if search.is_hasty or registered(values, known) or waited_s[search.zone] < patience_s:
            return None
        tried = named_periods([bit_s, *search.likely_s])
        return finding(Cause.NO_ID, zone=search.zone, blinks_db=search.blinks_db, tried=tried)

    def _begun(
        self, recording: Recording, samples: Samples, blinking: Any, waited_s: Any
    ) -> _Search | None:
        """Return a search for the strongest zone that has waited, and has a clock."""
        for zone in np.argsort(-blinking).tolist():
            if waited_s[zone] >= _PATIENCE_S:
                periods = bit_periods(recording, samples, zone)
                clocks_s = [one.bit_period_s for one in periods if one.strength > _CLOCKED]
                if clocks_s:
                    likely_s = candidates(clocks_s, frame_period(recording.stamp_ns))
                    return _Search(zone, float(blinking[zone]), likely_s)
        return None
