# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A detector that keeps the newest frames, to explain why markers are not read."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from retrolidar_ros.detector.agreement import Agreement
from retrolidar_ros.detector.detection import Candidate, Detection, Track
from retrolidar_ros.detector.explain import Explanation
from retrolidar_ros.detector.findings import Cause, Finding
from retrolidar_ros.detector.parameters import DetectorSettings
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid

_KEPT = 2048  # newest frames that are explained


class Decoding:
    """Takes frames one by one, as the node does."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Begin with values of all parameters of a detector; ValueError if one is invalid."""
        self._settings = DetectorSettings(values)
        self._begin(ZoneGrid())

    def _begin(self, grid: ZoneGrid) -> None:
        self._grid = grid
        self._detector = self._settings.detector(grid)
        self._agreement = Agreement(self._settings.values['min_readings'])
        self._newest: deque[Frame] = deque(maxlen=_KEPT)
        self._rejected: dict[int, Candidate] = {}  # the best of each zone
        self._read: list[Detection] = []
        self.detections: list[Detection] = []  # confirmed detections so far, of the last zone grid

    def detect(self, frames: Iterable[Frame]) -> Iterator[Detection]:
        """Yield the detections in frames as they become certain."""
        for detections, _ in self.steps(frames, follow=False):
            yield from detections

    def follow(self, frames: Iterable[Frame]) -> Iterator[Track]:
        """Yield the tracks of each frame; ValueError for a method that follows no markers."""
        if (method := self._settings.values['method']) != 'joint':
            raise ValueError(f'method {method} follows no markers; joint does')
        for _, tracks in self.steps(frames, follow=True):
            yield from tracks

    def steps(
        self, frames: Iterable[Frame], *, follow: bool
    ) -> Iterator[tuple[list[Detection], list[Track]]]:
        """Yield the detections that become certain with each frame, and its tracks if asked."""
        for frame in frames:
            if frame.grid != self._grid:
                self._begin(frame.grid)
            self._newest.append(frame)
            detections = self._detector.update(frame)
            self._read += detections
            confirmed = self._agreement.confirmed(detections)
            self.detections += confirmed
            for one in self._detector.candidates:
                best = self._rejected.get(one.zone)
                if one.reason and (best is None or one.evidence > best.evidence):
                    self._rejected[one.zone] = one
            tracks = self._detector.follow(frame) if follow else []
            yield confirmed, self._agreement.followed(tracks)

    def explanation(self) -> Explanation:
        """Return an explanation of the newest frames; ValueError if there are none."""
        recording = Recording.of(list(self._newest))
        begin_ns = recording.stamp_ns[0]
        newest = [one for one in self._read if one.stamp_ns >= begin_ns]
        withheld = 0 if self._agreement.passed else self._agreement.withheld
        return Explanation(recording, self._settings, newest, withheld)

    def table(self, explanation: Explanation, findings: list[Finding]) -> list[str]:
        """Return how each zone blinks, and its best candidate beside the thresholds."""
        read_ms = {z: 1e3 * one.bit_period_s for one in self._read for z in one.zones}
        advised = (one.values for one in findings if one.cause is Cause.BIT_PERIOD)
        bits_ms = {one['zone']: one['found_ms'] for one in advised} | read_ms
        lines = ['zone  blinks [dB]  bits [ms]  best ID  evidence  word  margin  rejected for']
        for zone in explanation.zones:
            bits = f'{bits_ms[zone.zone]:.1f}' if zone.zone in bits_ms else '-'
            best = self._rejected.get(zone.zone)
            if zone.zone in read_ms:
                outcome = '   read'
            elif best is None or best.reason is None:
                outcome = '   none'
            else:
                outcome = (
                    f'{best.id:7d}  {best.evidence:8.1f}  {best.word:4.1f}  {best.margin:6.1f}'
                    f'  {best.reason.value}'
                )
            lines.append(f'{zone.zone:4d}  {zone.modulation_db:11.1f}  {bits:>9}  {outcome}')
        if thresholds := self._detector.thresholds:
            lines.append(
                f'thresholds [nats]: evidence ≥ {thresholds.evidence:.1f}, '
                f'word ≤ {thresholds.word:.1f}, margin ≥ {thresholds.margin:.1f}'
            )
        return lines
