# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Why markers of a recording are not read. Each remedy is tried before it is advised."""

from collections.abc import Iterable, Iterator
from typing import Any

import numpy as np

from retrolidar_ros.detector.blinking_zones import (
    MIN_FRAMES,
    BlinkingZone,
    blinking_zones,
    valid_signal,
)
from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.findings import Cause, Finding, listed
from retrolidar_ros.detector.methods import MAX_PACKETS
from retrolidar_ros.detector.parameters import DetectorSettings
from retrolidar_ros.detector.trials import CAPTURE, Trial, best, candidates, every, is_among, trials
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import FRAMES_A_BIT, Floats, Recording, frame_period, valid_samples
from retrolidar_ros.sensor.model import NoiseLaw, Status

_TRIED_ON = 640  # newest frames
_MAX_ZONES = 4
NOISELESS = 1e-4
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
        settings: DetectorSettings,
        detections: Iterable[Detection] = (),
        withheld: int = 0,
    ) -> None:
        """Take a recording, and what was read of it, or withheld if it was all."""
        self.recording = recording
        self._settings = settings
        self._bit_s = settings.values['bit_period']
        self._frame_s = frame_period(recording)
        self._detections, self._withheld = list(detections), withheld
        law = settings.noise.lit(recording.ambient)
        self._noise_scale = noise_scale(recording, law)
        if self._noise_scale > 1:
            scale = self._noise_scale
            law = NoiseLaw(law.floor * scale, law.slope * scale, 0.0)
        self.zones = blinking_zones(recording, law)  # those that blink, strongest first
        self._trials: list[Trial] = []
        self._explained = self._seen(self._detections)

    def findings(self) -> list[Finding]:
        """Return why markers are not read; empty without evidence that they could be."""
        if len(self.recording) < MIN_FRAMES:
            packet_s, frames = PACKET_BITS * self._bit_s, len(self.recording)
            few = Finding(Cause.FEW_FRAMES, frames=frames, packet_s=packet_s)
            return [] if self._detections else [few]
        if self.recording.stamp_ns[0] == self.recording.stamp_ns[-1] or self._frame_s <= 0:
            return [Finding(Cause.STAMPS)]
        ids = dict.fromkeys(one.id for one in self._detections)
        found = [rate_finding(self._frame_s, self._bit_s), *map(self._rarely_read, ids)]
        result = [one for one in found if one is not None]
        if self._withheld:
            required = self._settings.values['min_readings']
            result.append(Finding(Cause.WITHHELD, withheld=self._withheld, required=required))
        if not self._detections:
            reasons = self._unregistered() or self._more_packets(0)
            result += reasons or self._unread(self.zones) or [self._nothing()]
        elif self.zones:
            # A much fainter zone may show a reflection of the marker.
            min_db = self.zones[0].modulation_db - _FAINTER_DB
            seen = [one for one in self.zones if one.is_clocked and one.modulation_db > min_db]
            if not self._explained.issuperset(one.zone for one in seen):
                result += [*self._unregistered(), *self._unread(seen)]
        if result:
            frames = self._bit_s / self._frame_s
            if FRAMES_A_BIT[0] <= frames < _TWO_FRAMES:
                result.append(Finding(Cause.SHORT_BITS, bit_ms=1e3 * self._bit_s, frames=frames))
            result += _surroundings(self.recording, self._noise_scale)
        return result

    def why(self, zone: BlinkingZone) -> Iterator[Finding | None]:
        """Yield why a zone is not read, after each trial.

        None before the likely ones are made, and if the configured bit period reads it after all.
        """
        values = {'zone': zone.zone, 'blinks_db': zone.modulation_db}
        likely_s = self._likely(zone)
        is_alike = not zone.is_clocked or is_among(self._bit_s, likely_s)
        if zone.contrast < _FLAT and is_alike:
            yield Finding(Cause.LOW_CONTRAST, percent=100 * zone.contrast, **values)
            return
        newest = self.recording.newest(_TRIED_ON)
        tried_s = [self._bit_s, *(one.tried_s for one in self._trials)]
        more = trials(newest, [*likely_s, *every(self._frame_s)], self._read_with, tried_s)
        while True:
            own = [one.within(zone.zone) for one in self._trials]
            read = best(own, newest, likely_s)
            is_sure = any(one.is_sure(newest) for one in own)
            tried_s = [self._bit_s, *(one.tried_s for one in own)]
            if not is_sure and not all(is_among(one, tried_s) for one in likely_s):
                yield None
            elif read:
                self._explained |= self._seen(read.detections)
                yield _bit_period(zone, read, self._bit_s) if self._is_another(read) else None
            elif not zone.is_clocked:
                yield Finding(Cause.NO_CLOCK, **values)
            else:
                tried = listed([f'{1e3 * one:.1f}' for one in tried_s])
                yield Finding(Cause.NO_ID, tried=tried, **values)
            trial = None if is_sure else next(more, None)
            if trial is None:
                return
            self._trials.append(trial)

    def _unread(self, zones: Iterable[BlinkingZone]) -> list[Finding]:
        result: list[Finding] = []
        for zone in zones:
            if zone.zone not in self._explained and len(result) < _MAX_ZONES:
                self._explained.add(zone.zone)
                *_, last = self.why(zone)
                if last is None:  # only trials with about the configured bit period read it
                    read = (one for trial in self._trials for one in trial.detections)
                    ids = _ids(one for one in read if zone.zone in one.zones)
                    last = Finding(Cause.FEW_READ, ids=ids, read=0, sent=self._sent(self._bit_s))
                result.append(last)
        return result

    def _sent(self, bit_s: float) -> int:
        """Return how many packets a marker sends while the recording lasts."""
        duration_s = (self.recording.stamp_ns[-1] - self.recording.stamp_ns[0]) * 1e-9
        return int(duration_s / (PACKET_BITS * bit_s))

    def _rarely_read(self, marker_id: int) -> Finding | None:
        """Return why few packets of a marker were read; None if they are not few."""
        own = [one for one in self._detections if one.id == marker_id]
        read = sum(one.packets for one in own)
        bit_s = float(np.median([one.bit_period_s for one in own]))
        sent = self._sent(bit_s)
        # A single reading beside others may be a false ID.
        if read >= _FEW * sent or (read == 1 and len(self._detections) > 1):
            return None
        zone = next((one for one in self.zones if one.zone in own[0].zones), None)
        if zone is not None:
            for trial in trials(self.recording, [bit_s, *self._likely(zone)], self._read_with):
                again = trial.within(zone.zone)
                if len(again.detections) > len(own) and self._is_another(again):
                    return _bit_period(zone, again, self._bit_s)
        few = Finding(Cause.FEW_READ, ids=marker_id, read=read, sent=sent)
        return next(iter(self._more_packets(read)), few)

    def _is_another(self, trial: Trial) -> bool:
        """Return whether the bit period of a trial is not the configured one."""
        return bool(abs(trial.bit_period_s / self._bit_s - 1) > CAPTURE / 2)

    def _more_packets(self, read: int) -> list[Finding]:
        """Return that a larger max_packets reads more, if it does."""
        packets = self._settings.values['max_packets']
        if packets == MAX_PACKETS:
            return []
        more = self._read(self.recording, max_packets=MAX_PACKETS)
        if sum(one.packets for one in more) <= read:
            return []
        return [Finding(Cause.MAX_PACKETS, ids=_ids(more), packets=packets)]

    def _unregistered(self) -> list[Finding]:
        """Return which unregistered IDs are seen in zones that are not explained."""
        if not self._settings.registered:
            return []
        anyone = self._read(self.recording, registered_ids=[], only_registered=False)
        read = [one for one in anyone if not self._explained.issuperset(one.zones)]
        self._explained |= self._seen(read)
        return [Finding(Cause.UNREGISTERED, ids=_ids(read))] if read else []

    def _nothing(self) -> Finding:
        """Return that nothing blinks, or which zone may see a marker at rest."""
        signal = np.median(self.recording.signal, axis=0)
        if signal.max() < _STANDS_OUT * max(float(np.median(signal)), 1.0):
            return Finding(Cause.NO_BLINKING)
        return Finding(Cause.STEADY, zone=int(signal.argmax()))

    def _likely(self, zone: BlinkingZone) -> list[float]:
        return candidates((one.bit_period_s for one in zone.periods), self._frame_s)

    def _read(self, recording: Recording, **changes: Any) -> list[Detection]:
        return self._settings.changed(**changes).detector(recording.grid).update_all(recording)

    def _read_with(self, recording: Recording, bit_s: float) -> list[Detection]:
        return self._read(recording, bit_period=bit_s)

    def _seen(self, detections: Iterable[Detection]) -> set[int]:
        """Return the zones of detections, and their neighbours."""
        zones = {zone for one in detections for zone in one.zones}
        return set(np.flatnonzero(self.recording.grid.near[sorted(zones)].any(axis=0)).tolist())


def rate_finding(frame_s: float, bit_s: float) -> Finding | None:
    """Return that a bit does not last one to eight frames, if so; periods in [s]."""
    frames = bit_s / frame_s
    if FRAMES_A_BIT[0] <= frames <= FRAMES_A_BIT[1]:
        return None
    values = {'frame_ms': 1e3 * frame_s, 'bit_ms': 1e3 * bit_s, 'two_s': 2 * frame_s}
    return Finding(Cause.FRAME_RATE, frames=frames, **values)


def _bit_period(zone: BlinkingZone, read: Trial, bit_s: float) -> Finding:
    """Return that a zone is read with another bit period than the configured one [s]."""
    return Finding(
        Cause.BIT_PERIOD,
        zone=zone.zone,
        blinks_db=zone.modulation_db,
        ids=_ids(read.detections),
        found_s=read.bit_period_s,
        found_ms=1e3 * read.bit_period_s,
        bit_ms=1e3 * bit_s,
    )


def _ids(detections: Iterable[Detection]) -> str:
    return ', '.join(map(str, sorted({one.id for one in detections})))


def noise_scale(recording: Recording, law: NoiseLaw) -> float:
    """Return the variance of the quietest quarter of zones over that of a noise law.

    It is less than `NOISELESS` only of an emulated recording without noise.
    """
    signal, valid, mean = valid_signal(recording)
    pairs = valid[1:] & valid[:-1]
    count = pairs.sum(axis=0)
    seen = count > MIN_FRAMES // 2
    if seen.mean() < _MIN_SEEN:
        return 1.0
    steps: Floats = np.where(pairs, np.diff(signal, axis=0), 0.0)
    scale = (steps**2).sum(axis=0) / np.maximum(count, 1) / 2 / law.variance(mean)
    return float(np.quantile(scale[seen], 0.25))


def _surroundings(recording: Recording, noise_scale: float) -> list[Finding]:
    result = []
    if noise_scale < NOISELESS:
        result.append(Finding(Cause.NO_NOISE))
    elif not 1 / _MAX_NOISE < noise_scale < _MAX_NOISE:
        result.append(Finding(Cause.NOISE, scale=noise_scale))
    with np.errstate(invalid='ignore'):
        near = np.flatnonzero((recording.distance < _GLASS_M).mean(axis=0) > _FEW).tolist()
    if near:
        result.append(Finding(Cause.GLASS, zones=listed(near), nearer_cm=100 * _GLASS_M))
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    bad = ~valid & (recording.status != Status.NO_TARGET)
    if lame := np.flatnonzero(bad.mean(axis=0) > _FEW).tolist():
        status = int(np.bincount(recording.status[bad]).argmax())
        result.append(Finding(Cause.INVALID, zones=listed(lame), status=status))
    ambient = recording.ambient.mean(axis=1)
    if np.std(np.diff(ambient)) > _FLICKER * max(float(ambient.mean()), 1.0):
        result.append(Finding(Cause.FLICKER))
    return result
