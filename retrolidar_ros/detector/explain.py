# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why markers of a recording are not read. Each remedy is tried before it is advised."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from typing import Any

import numpy as np

from retrolidar_ros.detector.blinking_zones import (
    MIN_FRAMES,
    BlinkingZone,
    blinking_zones,
)
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.findings import Cause, Finding, finding, named_periods, named_zones
from retrolidar_ros.detector.methods import MAX_PACKETS
from retrolidar_ros.detector.parameters import detector_of, noise_of, registered
from retrolidar_ros.detector.rejections import adjacency
from retrolidar_ros.detector.trials import (
    CAPTURED,
    Trial,
    best,
    candidates,
    every,
    is_among,
    trials,
)
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.marker.known_markers import KnownMarker
from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.sensor.frame_rate import FRAMES_A_BIT, frame_period
from retrolidar_ros.sensor.model import Status
from retrolidar_ros.sensor.noise import NoiseLaw

_TRIED_ON = 640  # newest frames
_MAX_ZONES = 4
_MAX_NOISE = 2.0  # times the configured value
_FEW = 0.5  # share of a marker's packets
_GLASS_M = 0.05
_FAINTER_DB = 12.0
_STANDS_OUT = 5.0
_FLICKER = 0.1  # of the ambient light, from frame to frame
_FLAT = 0.15
_TWO_FRAMES = 1.9
_MIN_SEEN = 0.25  # of the zones, to tell their noise


class Explanation:
    """Evidence that more markers could be read from a recording."""

    def __init__(
        self,
        recording: Recording,
        values: Mapping[str, Any],
        known: Mapping[int, KnownMarker],
        detections: Iterable[Detection],
        withheld: int = 0,
    ) -> None:
        """Look at two frames or more, and what a detector of values and known markers read.

        Of that so much is withheld, if all is.
        """
        self.recording = recording
        self._values, self._known = values, known
        self._bit_s = values['bit_period']
        self._frame_s = frame_period(recording.stamp_ns)
        self._detections, self._withheld = list(detections), withheld
        law = noise_of(values).lit(recording.ambient)
        self._scale = _noise_scale(recording, law)
        if self._scale > 1:
            law = NoiseLaw(law.floor * self._scale, law.slope * self._scale, 0.0)
        self.zones = blinking_zones(recording, law)
        """Those that blink, strongest first."""
        self._trials: list[Trial] = []
        self._near = adjacency(recording.grid)
        self._explained = self._seen(self._detections)

    def findings(self) -> list[Finding]:
        """Return why markers are not read; empty without evidence that they could be."""
        if len(self.recording) < MIN_FRAMES:
            packet_s, frames = PACKET_BITS * self._bit_s, len(self.recording)
            few = finding(Cause.FEW_FRAMES, frames=frames, packet_s=packet_s)
            return [] if self._detections else [few]
        if self._frame_s <= 0:
            return [finding(Cause.STAMPS)]
        found = [rate_finding(self._frame_s, self._bit_s), *map(self._less, self._ids())]
        result = [one for one in found if one is not None]
        if self._withheld:
            least = self._values['min_readings']
            result.append(finding(Cause.WITHHELD, withheld=self._withheld, least=least))
        if not self._detections:
            reasons = self._unregistered() or self._patience(0)
            result += reasons or self._unread(self.zones) or [self._nothing()]
        elif self.zones:
            # A much fainter zone may show a reflection of the marker.
            least_db = self.zones[0].modulation_db - _FAINTER_DB
            clocked = [one for one in self.zones if one.is_clocked and one.modulation_db > least_db]
            result += self._unread(clocked)
        if result:
            frames = self._bit_s / self._frame_s
            if FRAMES_A_BIT[0] <= frames < _TWO_FRAMES:
                result.append(finding(Cause.SHORT_BITS, bit_ms=1e3 * self._bit_s, frames=frames))
            result += _surroundings(self.recording, self._scale)
        return result

    def _ids(self) -> list[int]:
        return list(dict.fromkeys(one.id for one in self._detections))

    def _read(self, recording: Recording, **changes: Any) -> list[Detection]:
        """Read a recording with other values."""
        detector = detector_of({**self._values, **changes}, recording.grid, self._known)
        return detector.update_all(recording)

    def _seen(self, detections: Iterable[Detection]) -> set[int]:
        """Return the zones of detections, and their neighbours."""
        zones = {zone for one in detections for zone in one.zones}
        return set(np.flatnonzero(self._near[sorted(zones)].any(axis=0)).tolist())

    def _less(self, identity: int) -> Finding | None:
        """Return why few packets of a marker were read; None if they are not few."""
        own = [one for one in self._detections if one.id == identity]
        read = sum(one.packets for one in own)
        bit_s = float(np.median([one.bit_period_s for one in own]))
        duration_s = (self.recording.stamp_ns[-1] - self.recording.stamp_ns[0]) * 1e-9
        sent = int(duration_s / (PACKET_BITS * bit_s))
        few = read < _FEW * sent
        # A single reading beside others may be a false ID; alone, it may have another bit period.
        if (read == 1 and len(self._ids()) > 1) or not (few or (len(own) == 1 and sent > 2)):
            return None
        zone = next((one for one in self.zones if one.zone in own[0].zones), None)
        if zone is not None:
            likely_s = [bit_s] if self._is_another(bit_s) else []
            likely_s += [one for one in self._likely(zone) if not is_among(one, [self._bit_s])]
            for trial in trials(self.recording, likely_s, self._by):
                again = trial.within(zone.zone)
                if len(again.detections) > len(own) and self._is_another(again.bit_period_s):
                    return period_finding(zone.zone, zone.modulation_db, again, self._bit_s)
        if not few:
            return None
        if more := self._patience(read):
            return more[0]
        return finding(Cause.FEW_READ, ids=identity, read=read, sent=sent)

    def _is_another(self, bit_s: float) -> bool:
        """Return whether a bit period differs from the configured one."""
        return bool(abs(bit_s / self._bit_s - 1) > CAPTURED / 2)

    def _likely(self, zone: BlinkingZone) -> list[float]:
        """Return the possible bit periods of a zone [s]."""
        return candidates((one.bit_period_s for one in zone.periods), self._frame_s)

    def _by(self, recording: Recording, bit_s: float) -> list[Detection]:
        return self._read(recording, bit_period=bit_s)

    def _patience(self, read: int) -> list[Finding]:
        """Return that a larger max_packets reads more, if it does."""
        packets = self._values['max_packets']
        if packets == MAX_PACKETS:
            return []
        more = self._read(self.recording, max_packets=MAX_PACKETS)
        if sum(one.packets for one in more) <= read:
            return []
        ids = ', '.join(map(str, sorted({one.id for one in more})))
        return [finding(Cause.MAX_PACKETS, ids=ids, packets=packets)]

    def _unregistered(self) -> list[Finding]:
        """Return which unregistered IDs are seen."""
        if not registered(self._values, self._known):
            return []
        read = self._read(self.recording, registered_ids=[], only_registered=False)
        ids = ', '.join(map(str, sorted({one.id for one in read})))
        return [finding(Cause.UNREGISTERED, ids=ids)] if ids else []

    def _unread(self, zones: list[BlinkingZone]) -> list[Finding]:
        """Return why zones that blink are not read."""
        result: list[Finding] = []
        for zone in zones:
            if zone.zone not in self._explained and len(result) < _MAX_ZONES:
                self._explained.add(zone.zone)
                if found := self.why(zone, self._trials):
                    result.append(found)
        return result

    def why(self, zone: BlinkingZone, done: list[Trial], most: int | None = None) -> Finding | None:
        """Return why a zone is not read.

        Parameters
        ----------
        zone : BlinkingZone
            Which blinks.
        done : list of Trial
            Those of former calls, to which new ones are added.
        most : int, optional
            How many are added at most. None is returned while likely ones are to be tried.
        """
        values = {'zone': zone.zone, 'blinks_db': zone.modulation_db}
        likely_s = self._likely(zone)
        fits = not zone.is_clocked or is_among(self._bit_s, likely_s)
        if zone.contrast < _FLAT and fits:
            return finding(Cause.LOW_CONTRAST, percent=100 * zone.contrast, **values)
        newest = self.recording.newest(_TRIED_ON)
        tried_s = [self._bit_s, *(one.tried_s for one in done)]
        sure = any(one.within(zone.zone).is_sure(newest) for one in done)
        periods_s = [*likely_s, *every(self._frame_s)]
        for trial in islice(trials(newest, periods_s, self._by, tried_s), 0 if sure else most):
            done.append(trial)
            if sure := trial.within(zone.zone).is_sure(newest):
                break
        if most and not sure and len(done) < len(likely_s):
            return None
        if read := best((one.within(zone.zone) for one in done), newest, likely_s):
            self._explained |= self._seen(read.detections)
            return period_finding(zone.zone, zone.modulation_db, read, self._bit_s)
        if not zone.is_clocked:
            return finding(Cause.NO_CLOCK, **values)
        tried_s = likely_s if most else [one.tried_s for one in done]
        tried_s = [one for one in tried_s if not is_among(one, [self._bit_s])]
        return finding(Cause.NO_ID, tried=named_periods([self._bit_s, *tried_s]), **values)

    def _nothing(self) -> Finding:
        """Return that nothing blinks, or which zone may see a marker at rest."""
        signal = np.median(self.recording.signal, axis=0)
        if signal.max() < _STANDS_OUT * max(float(np.median(signal)), 1.0):
            return finding(Cause.NO_BLINKING)
        return finding(Cause.STEADY, zone=int(signal.argmax()))


def period_finding(zone: int, blinks_db: float, trial: Trial, bit_s: float) -> Finding:
    """Return that a trial reads a zone with another bit period than the configured one [s]."""
    return finding(
        Cause.BIT_PERIOD,
        zone=zone,
        blinks_db=blinks_db,
        ids=', '.join(map(str, sorted({one.id for one in trial.detections}))),
        found_s=trial.bit_period_s,
        found_ms=1e3 * trial.bit_period_s,
        bit_ms=1e3 * bit_s,
    )


def rate_finding(frame_s: float, bit_s: float) -> Finding | None:
    """Return that a bit does not last one to eight frames, if so; periods in [s]."""
    frames = bit_s / frame_s
    if FRAMES_A_BIT[0] <= frames <= FRAMES_A_BIT[1]:
        return None
    return finding(Cause.FRAME_RATE, frame_ms=1e3 * frame_s, bit_ms=1e3 * bit_s, frames=frames)


def _noise_scale(recording: Recording, law: NoiseLaw) -> float:
    """Return the variance of the quietest quarter of zones over that of a noise law."""
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    signal = recording.signal.astype(np.float64)
    pairs = valid[1:] & valid[:-1]
    count = pairs.sum(axis=0)
    if np.count_nonzero(count > MIN_FRAMES // 2) < _MIN_SEEN * len(count):
        return 1.0
    steps: Floats = np.where(pairs, np.diff(signal, axis=0), 0.0)
    mean = (signal * valid).sum(axis=0) / np.maximum(valid.sum(axis=0), 1)
    scale = (steps**2).sum(axis=0) / np.maximum(count, 1) / 2 / law.variance(mean)
    return float(np.quantile(scale[count > MIN_FRAMES // 2], 0.25))


def _surroundings(recording: Recording, scale: float) -> list[Finding]:
    """Return what is wrong with the noise and the light."""
    result = []
    if not 1 / _MAX_NOISE < scale < _MAX_NOISE:
        result.append(finding(Cause.NOISE, scale=scale))
    with np.errstate(invalid='ignore'):
        near = np.flatnonzero((recording.distance < _GLASS_M).mean(axis=0) > _FEW).tolist()
    if near:
        result.append(finding(Cause.GLASS, zones=named_zones(near), nearer_cm=100 * _GLASS_M))
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    bad = ~valid & (recording.status != Status.NO_TARGET)
    if lame := np.flatnonzero(bad.mean(axis=0) > _FEW).tolist():
        status = int(np.bincount(recording.status[bad]).argmax())
        result.append(finding(Cause.INVALID, zones=named_zones(lame), status=status))
    ambient = recording.ambient.mean(axis=1)
    if np.std(np.diff(ambient)) > _FLICKER * max(float(ambient.mean()), 1.0):
        result.append(finding(Cause.FLICKER))
    return result
