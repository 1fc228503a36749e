# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why less was read of frames than could be: in sentences, each with what to do about it."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.blinking_zones import (
    LEAST_FRAMES,
    LOW_CONTRAST,
    BlinkingZone,
    blinking_zones,
    clock_mismatch,
    too_slow,
    unread,
)
from retrolidar_ros.detector.detection import Detection, Detector
from retrolidar_ros.detector.likelihood_detector import Candidate, LikelihoodDetector
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.detector.parameters import detector_of, known_markers, noise_of, registered
from retrolidar_ros.detector.tracks import Track
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Floats, Frame, Recording, Status, valid_samples

_KEPT = 2048  # newest frames, which are looked at
_MOST_NOISE = 2.0  # times what it is said to be
_FEW = 0.5  # of the packets of a marker that was read
_GLASS_M = 0.05
_FAINTER_DB = 12.0
_MOST_NAMED = 4
_STANDS_OUT = 5.0
_FLICKER = 0.1  # of the ambient light, from frame to frame


class Decoding:
    """Takes frames one by one, as the node does, and keeps what is needed to say why."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        """Begin with values of all parameters of a detector; ValueError if they cannot be."""
        self.values = values
        self._known = known_markers(values)
        registered(values, self._known)
        self._detector: Detector | None = None
        self._newest: deque[Frame] = deque(maxlen=_KEPT)
        self.rejected: dict[int, Candidate] = {}
        """The best of each zone that was not read."""
        self.packets: Counter[int] = Counter()
        """Packets that were read, by ID."""
        self._periods_s: dict[int, float] = {}
        self._zones: set[int] = set()

    def detect(self, frames: Iterable[Frame]) -> Iterator[Detection]:
        """Yield the detections in frames as they become certain."""
        for detections, _ in self.steps(frames, follow=False):
            yield from detections

    def follow(self, frames: Iterable[Frame]) -> Iterator[Track]:
        """Yield the tracks of each frame; ValueError for a method that follows no markers."""
        if self.values['method'] != 'joint':
            raise ValueError(f'method {self.values["method"]} follows no markers; joint does')
        for _, tracks in self.steps(frames, follow=True):
            yield from tracks

    def steps(
        self, frames: Iterable[Frame], *, follow: bool
    ) -> Iterator[tuple[list[Detection], list[Track]]]:
        """Yield the detections that become certain with each frame, and its tracks if asked."""
        grid = self._newest[-1].grid if self._newest else None
        for frame in frames:
            if frame.grid is not grid and frame.grid != grid:
                grid = frame.grid
                self._newest.clear()
                self._detector = detector_of(self.values, grid, self._known)
            self._newest.append(frame)
            assert self._detector is not None
            detections = self._detector.update(frame)
            for detection in detections:
                self.packets[detection.id] += detection.packets
                self._periods_s[detection.id] = detection.bit_period_s
                self._zones.update(detection.zones)
            tracks: list[Track] = []
            if isinstance(self._detector, LikelihoodDetector):
                tracks = self._detector.follow(frame) if follow else tracks
                for one in self._detector.candidates:
                    best = self.rejected.get(one.zone)
                    if one.reason and (best is None or one.evidence > best.evidence):
                        self.rejected[one.zone] = one
            yield detections, tracks

    def blinking(self) -> tuple[Recording, list[BlinkingZone], float]:
        """Return the newest frames, their zones that blink, and the noise against the law."""
        recording = Recording.of(list(self._newest))
        law = noise_of(self.values).lit(recording.ambient)
        scale = _noise_scale(recording, law)
        if scale > 1:
            law = NoiseLaw(law.floor * scale, law.slope * scale, 0.0)
        return recording, blinking_zones(recording, law), scale

    def why(self) -> list[str]:
        """Return why less was read than could be; empty if nothing speaks for it."""
        if len(self._newest) < LEAST_FRAMES:
            few = f'{len(self._newest)} frames are too few: a packet takes a second and more'
            return [] if self.packets else [few]
        recording, zones, scale = self.blinking()
        time_s = recording.stamp_ns * 1e-9
        frame_s = float(np.median(np.diff(time_s)))
        found = self._less(float(time_s[-1] - time_s[0]))
        bit_s = self.values['bit_period']
        if not self.packets:
            found += self._unregistered(recording) or unread(zones, frame_s, bit_s)
            found += [] if zones else _steady(recording)
        else:
            # What blinks beside a marker and much fainter is its own light in another zone.
            bright = [
                one for one in zones if one.modulation_db > zones[0].modulation_db - _FAINTER_DB
            ]
            other = [one for one in bright if found or one.zone not in self._zones]
            wrong = [one for one in other if clock_mismatch(one.periods, bit_s)]
            found += unread(wrong[:1], frame_s, bit_s) if wrong else too_slow(frame_s, bit_s)
        if found:
            found += _about(recording, scale)
        return found

    def _less(self, duration_s: float) -> list[str]:
        """Say of which markers few packets were read."""
        found = []
        for identity, packets in self.packets.items():
            sent = int(duration_s / (PACKET_BITS * self._periods_s[identity]))
            # A single one beside others may be no marker's.
            if packets < _FEW * sent and (packets > 1 or len(self.packets) == 1):
                found.append(
                    f'ID {identity} was read in {packets} packets, and could have been in {sent} '
                    'if it repeats them: it is faint, hidden at times, or noisier than set'
                )
        return found

    def _unregistered(self, recording: Recording) -> list[str]:
        """Say which IDs are there that were not to come."""
        if not registered(self.values, self._known):
            return []
        everyone = {**self.values, 'registered_ids': [], 'only_registered': False}
        detector = detector_of(everyone, recording.grid, self._known)
        ids = sorted({detection.id for detection in detector.update_all(recording)})
        names = ', '.join(map(str, ids))
        return [f'ID {names} would be read: add it to registered_ids'] if ids else []

    def table(self) -> list[str]:
        """Return how each zone blinks, and its best candidate beside the thresholds."""
        if len(self._newest) < 2:
            return ['no zone to describe']
        _, zones, _ = self.blinking()
        lines = ['zone  blinks [dB]  bits [ms]  best ID  evidence  word  margin  rejected for']
        for zone in zones:
            text = f'{zone.zone:4d}  {zone.modulation_db:11.1f}  {1e3 * zone.bit_period_s:9.1f}'
            best = self.rejected.get(zone.zone)
            if zone.zone in self._zones:
                text += '     read'
            elif best is None or best.reason is None:
                text += '     none'
            else:
                text += (
                    f'  {best.id:7d}  {best.evidence:8.1f}  {best.word:4.1f}  {best.margin:6.1f}'
                    f'  {best.reason.value}'
                )
            lines.append(text)
        if isinstance(self._detector, LikelihoodDetector):
            asked = self._detector.demands
            lines.append(
                f'asked: evidence {asked.evidence:.1f} at least, word {asked.word:.1f} at most, '
                f'margin {asked.margin:.1f} at least [nats]'
            )
        return lines


def _noise_scale(recording: Recording, law: NoiseLaw) -> float:
    """Return by how many times the quietest quarter of zones varies more than a law says."""
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    signal = recording.signal.astype(np.float64)
    pairs = valid[1:] & valid[:-1]
    count = pairs.sum(axis=0)
    if not (count > LEAST_FRAMES // 2).any():
        return 1.0
    steps: Floats = np.where(pairs, np.diff(signal, axis=0), 0.0)
    mean = (signal * valid).sum(axis=0) / np.maximum(valid.sum(axis=0), 1)
    scale = (steps**2).sum(axis=0) / np.maximum(count, 1) / 2 / law.variance(mean)
    return float(np.quantile(scale[count > LEAST_FRAMES // 2], 0.25))


def _steady(recording: Recording) -> list[str]:
    """Say which zone may see a marker that does not blink."""
    signal = np.median(recording.signal, axis=0)
    if signal.max() < _STANDS_OUT * max(float(np.median(signal)), 1.0):
        return []
    brightest = f'zone {signal.argmax()} is by far the brightest, and steady'
    return [f'{brightest}: if that is a marker, {LOW_CONTRAST}']


def _zones(zones: NDArray[np.intp]) -> str:
    named = ', '.join(map(str, zones[:_MOST_NAMED]))
    others = len(zones) - _MOST_NAMED
    return f'zone {named}' + (f' and {others} more' if others > 0 else '')


def _about(recording: Recording, scale: float) -> list[str]:
    """Say what is wrong with the noise and the light."""
    found = []
    if not 1 / _MOST_NOISE < scale < _MOST_NOISE:
        found.append(
            f'zones at rest vary by {scale:.2g} times what noise_floor, noise_slope and '
            'noise_ambient say: let `retrolidar calibrate` find them'
        )
    with np.errstate(invalid='ignore'):
        near = np.flatnonzero((recording.distance < _GLASS_M).mean(axis=0) > _FEW)
    if len(near):
        found.append(
            f'{_zones(near)} sees something nearer than {100 * _GLASS_M:.0f} cm, '
            'such as a cover glass: what is fainter is not seen behind it; take it off or clean it'
        )
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    bad = ~valid & (recording.status != Status.NO_TARGET)
    lame = np.flatnonzero(bad.mean(axis=0) > _FEW)
    if len(lame):
        code = np.bincount(recording.status[bad]).argmax()
        found.append(
            f'{_zones(lame)} gives invalid samples for the most part, as of status {code}: '
            'shade it from the sun, clean the window, and let something be within reach'
        )
    ambient = recording.ambient.mean(axis=1)
    if np.std(np.diff(ambient)) > _FLICKER * max(float(ambient.mean()), 1.0):
        found.append(
            'the ambient light flickers from frame to frame: another sensor shines into the view, '
            'or a lamp; turn one of them away'
        )
    return found
