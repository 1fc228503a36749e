# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether frames come as a detector needs them, and whether what blinks in them is read."""

from __future__ import annotations

from collections import deque
from itertools import pairwise

import numpy as np

from retrolidar_ros.detector.blinking import Samples, modulation_db
from retrolidar_ros.detector.blinking_zones import CAPTURED, bit_periods
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.frame_rate import RATE_FRAMES, missing_frames, rate_mismatch

_KEPT = 256
_LEAST_KEPT = 128
# A zone that varies by less may do so by something that moves far away, or by noise.
_CLEARLY_DB = 6.0
# Lines of a spectrum that are no chance.
_CLOCKED = 12.0
# For so long a zone may blink unread by other bits, and for so many packets by the right ones: a
# detector combines eight.
_PATIENCE_S = 1.5
_PACKETS = 9
_STEADY = 0.01  # two looks agree so well on the bits of a marker
_LOOKING_S = 0.9  # a look costs a millisecond


class Reception:
    """Counts frames, and watches the newest of them for what blinks without being read."""

    def __init__(self, grid: ZoneGrid) -> None:
        """Begin with no frame of `grid`."""
        self.frames = 0
        self.lost = 0
        """Frames that the sequence counter says were sent, and that never came."""
        self.unsent = 0
        """Frames that the counter misses, too, but that the node before this one did not send."""
        self.repeated = 0
        """Frames that came a second time, and were left out."""
        self.reversed = 0
        """Frames with a counter before the last one: a sensor restarted, or there are two."""
        self._kept: deque[Frame] = deque(maxlen=_KEPT)
        self.restart(grid)

    def restart(self, grid: ZoneGrid) -> None:
        """Forget the frames that are kept, not the counts: others follow, of another grid maybe."""
        self._kept.clear()
        place = np.stack(np.divmod(np.arange(grid.zones), grid.columns))
        self._beside = np.abs(place[:, :, None] - place[:, None]).max(axis=0) <= 1
        self._explained_ns = np.zeros(grid.zones, dtype=np.int64)
        self._looked_ns, self._unread, self._suspected_s = 0, '', np.inf

    def take(self, frame: Frame, max_lost: int | None = None) -> bool:
        """Count a frame; return whether it is a new one.

        Before it at most `max_lost` were lost on the way here, if that is known.
        """
        self.frames += 1
        if self._kept:
            last = self._kept[-1]
            if (frame.sequence, frame.stamp_ns) == (last.sequence, last.stamp_ns):
                self.repeated += 1
                return False
            missing = missing_frames(last.sequence, frame.sequence)
            lost = missing if max_lost is None else min(missing, max_lost)
            self.lost += lost
            self.unsent += missing - lost
            self.reversed += frame.sequence < last.sequence
        else:
            self._explained_ns[:] = frame.stamp_ns
        self._kept.append(frame)
        return True

    def read(self, detections: list[Detection]) -> None:
        """Take note of what was read, which explains why its zones and those beside them blink."""
        for detection in detections:
            for zone in detection.zones:
                self._explained_ns[self._beside[zone]] = detection.end_ns

    def rate_problem(self, bit_period_s: float) -> str:
        """Say if a bit does not last two of the newest frames; empty if it does."""
        newest = list(self._kept)[-RATE_FRAMES:]
        if len(newest) < RATE_FRAMES:
            return ''
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
        return rate_mismatch(np.cumsum([0, *steps]).tolist(), bit_period_s)

    def unread_problem(self, law: NoiseLaw, bit_period_s: float, *, all_come: bool) -> str:
        """Say which zone blinks by a clock and is not read, and why; empty if there is none.

        Parameters
        ----------
        law : NoiseLaw
            Of the sensor.
        bit_period_s : float
            That of the detector [s].
        all_come : bool
            Whether every ID may come: a marker that may not is not missed.
        """
        if len(self._kept) < _LEAST_KEPT:
            return ''
        if abs(self._kept[-1].stamp_ns - self._looked_ns) < _LOOKING_S * 1e9:
            return self._unread
        self._looked_ns = self._kept[-1].stamp_ns
        self._unread = self._look(law, bit_period_s, all_come=all_come)
        return self._unread

    def _look(self, law: NoiseLaw, bit_period_s: float, *, all_come: bool) -> str:
        """Return why the strongest zone that has waited for long enough is not read."""
        recording = Recording.of(list(self._kept))
        samples = Samples.of(recording)
        blinking = modulation_db(samples, law.lit(recording.ambient))
        now_ns = self._looked_ns
        # Stamps may go back, where a bag is played again.
        quiet = ~(blinking >= _CLEARLY_DB) | (self._explained_ns > now_ns)
        self._explained_ns[quiet] = now_ns
        waited_s = (now_ns - self._explained_ns) * 1e-9
        for zone in np.argsort(-blinking):
            if waited_s[zone] < _PATIENCE_S:
                continue
            periods = [
                p for p in bit_periods(recording, samples, int(zone)) if p.strength > _CLOCKED
            ]
            if not periods:
                continue
            text = f'zone {zone} blinks by {blinking[zone]:.0f} dB and is not read: '
            near = [p for p in periods if abs(p.bit_period_s / bit_period_s - 1) <= CAPTURED]
            if not near:
                bit_s, before_s = periods[0].bit_period_s, self._suspected_s
                self._suspected_s = bit_s
                if abs(bit_s / before_s - 1) > _STEADY:  # as while stamps have not settled yet
                    return ''
                return (
                    f'{text}its bits last {1e3 * bit_s:.1f} ms, and bit_period is '
                    f'{1e3 * bit_period_s:.1f} ms'
                )
            if all_come and waited_s[zone] >= _PACKETS * PACKET_BITS * bit_period_s:
                return f'{text}too faint, disturbed, or of another code'
        return ''
