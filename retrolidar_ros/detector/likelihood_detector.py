# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The default detector: the core (`core/src/retrolidar_detector.h`) searches and decides."""

import math
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.core import array, ffi, lib
from retrolidar_ros.detector.detection import (
    Bearing,
    Candidate,
    Detection,
    DetectorCounts,
    Reason,
    Thresholds,
    Track,
    check_grid,
    place,
)
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.model import SensorModel

_MIN_HELD = 1100  # frames: eight packets at two frames a bit, or one at more than thirty
_SETTLED_PACKETS = 1.5  # by then, any packet that explains a candidate has been read
_SLACK = 0.1  # of a packet
_READ = 256  # newest readings that candidates are compared with
_ACROSS_M_S = 0.5  # deviation of a velocity across the line of sight, which is not measured
_ACROSS = _ACROSS_M_S**2 * np.eye(3)


# By their numbers in the core, which knows nothing of a missing distance.
_REASONS = {int(getattr(lib, f'RL_{one.name}')): one for one in Reason if one != Reason.DISTANCE}


class Rejections:
    """Counts rejected candidates, once it is certain that no packet explains them."""

    def __init__(self, grid: ZoneGrid) -> None:
        self.counts: Counter[str] = Counter()
        self._near = grid.near
        self._pending: deque[tuple[int, Candidate]] = deque()
        self._read: deque[Detection] = deque(maxlen=_READ)

    def take(self, candidates: list[Candidate], detections: list[Detection], now_ns: int) -> None:
        """Take the candidates and the readings of a frame."""
        self.settle(now_ns)
        self._pending += ((now_ns, one) for one in candidates if one.reason)
        self._read += detections

    def settle(self, now_ns: int) -> None:
        """Count the candidates that are old enough and not explained."""
        while self._pending:
            judged_ns, one = self._pending[0]
            packet_ns = PACKET_BITS * one.bit_period_s * 1e9
            if 0 <= now_ns - judged_ns < _SETTLED_PACKETS * packet_ns:
                break
            self._pending.popleft()
            if one.reason and not self._is_read(one, packet_ns):
                self.counts[one.reason.value] += 1

    def _is_read(self, candidate: Candidate, packet_ns: float) -> bool:
        """Return whether something was read in, or beside, a candidate's zone, at its time."""
        zones = len(self._near)
        # Where only an end of a packet was seen, its time is not known well.
        begin_ns = candidate.start_ns - _SLACK * packet_ns
        end_ns = candidate.start_ns + (1 + _SLACK) * packet_ns
        return any(
            one.start_ns < end_ns
            and begin_ns < one.end_ns
            and (candidate.zone >= zones or self._near[candidate.zone, list(one.zones)].any())
            for one in self._read
        )


class LikelihoodDetector:
    """Reads markers in all zones at once, frame by frame or many frames at a time."""

    def __init__(
        self,
        grid: ZoneGrid,
        *,
        bit_period_s: float,
        thresholds: Thresholds,
        max_packets: int,
        ids: NDArray[np.int64],
        sensor: SensorModel,
    ) -> None:
        """Prepare for frames of `grid`; the others as of `create_detector`; `ids` are read."""
        self.candidates: Sequence[Candidate] = []
        self._grid = replace(grid, view=sensor.field_of_view)
        self._unplaced = 0
        self._rejections = Rejections(grid)
        self.thresholds: Thresholds | None = thresholds
        settings = ffi.new(
            'struct rl_settings *',
            {
                'sensor': core_sensor(sensor, self._grid)[0],
                'max_packets': max_packets,
                'kept': _MIN_HELD,
                'bit_s': bit_period_s,
                'thresholds': thresholds._asdict(),
            },
        )
        core = lib.rl_detector_create(settings, array('uint16_t', ids), len(ids))
        if core == ffi.NULL:
            raise MemoryError('no memory for the samples of the detector')
        self._core = ffi.gc(core, lib.rl_detector_destroy)
        self._sensor = sensor
        self._tracks: Any = None

    def follow(self, frame: Frame) -> list[Track]:
        """Return the markers at the newest frame, followed from the first call on."""
        if self._tracks is None:
            tracks = lib.rl_tracks_create(self._core)
            if tracks == ffi.NULL:
                raise MemoryError('no memory for tracks')
            self._tracks = ffi.gc(tracks, lib.rl_tracks_destroy)
        count = lib.rl_tracks_follow(self._tracks)
        origin_ns = lib.rl_detector_newest(self._core).origin_ns
        tracks = (lib.rl_tracks_track(self._tracks, index) for index in range(count))
        return [_track(one, frame.stamp_ns, origin_ns) for one in tracks]

    @property
    def counts(self) -> DetectorCounts:
        """What was counted so far; a candidate that lost to a packet that was read is none."""
        counts = lib.rl_detector_counts(self._core)
        accepted = counts.accepted - self._unplaced
        rejected = self._rejections.counts.copy()
        if self._unplaced:
            rejected[Reason.DISTANCE.value] = self._unplaced
        tracks = lib.rl_tracks_counts(self._tracks) if self._tracks is not None else None
        return DetectorCounts(
            candidates=accepted + sum(rejected.values()),
            accepted=accepted,
            rejected=rejected,
            impossible=counts.impossible,
            overloads=counts.overloads,
            tracks_ended=tracks.ended if tracks else 0,
            tracks_dropped=tracks.dropped if tracks else 0,
        )

    def update(self, frame: Frame) -> list[Detection]:
        """Take the next frame; return the detections that became certain with it."""
        return self._push(frame, np.array([frame.stamp_ns]))

    def update_all(self, recording: Recording) -> list[Detection]:
        """Take many frames, faster than one by one."""
        return self._push(recording, recording.stamp_ns)

    def _push(self, frames: Frame | Recording, stamp_ns: NDArray[np.int64]) -> list[Detection]:
        """Give frames to the core, which returns early where it has judged something."""
        check_grid(frames.grid, self._grid)
        stamps = array('int64_t', stamp_ns)
        values = [array('float', one) for one in (frames.signal, frames.distance, frames.ambient)]
        values.append(array('uint8_t', frames.status))
        detections: list[Detection] = []
        self.candidates = judged = list[Candidate]()
        taken, count = 0, len(stamp_ns)
        while taken < count:
            left = (one + taken * self._grid.zones for one in values)
            taken += lib.rl_detector_push(self._core, count - taken, stamps + taken, *left)
            if lib.rl_detector_newest(self._core).candidates:
                detections += self._take(int(stamp_ns[taken - 1]), judged)
        if count:
            self._rejections.settle(int(stamp_ns[-1]))
        return detections

    def _take(self, now_ns: int, judged: list[Candidate]) -> list[Detection]:
        """Return the detections of the newest frame, and append its candidates."""
        newest = lib.rl_detector_newest(self._core)
        candidates = [
            Candidate(
                id=one.id,
                zone=one.channel,
                packets=one.packets,
                reason=_REASONS.get(one.reason),
                start_ns=newest.origin_ns + round(one.transmission.start_s * 1e9),
                bit_period_s=one.transmission.bit_s,
                evidence=one.evidence,
                word=one.word,
                margin=one.margin,
            )
            for one in newest.candidate[0 : newest.candidates]
        ]
        judged += candidates
        detections = []
        for reading in newest.reading[0 : newest.readings]:
            if reading.is_placed:
                detections.append(self._detection(reading, newest.origin_ns))
            else:
                self._unplaced += 1
        self._rejections.take(candidates, detections, now_ns)
        return detections

    def _detection(self, reading: Any, origin_ns: int) -> Detection:
        """Return a reading that the core has placed, whose times are since an origin."""
        read, where, pitch = reading.verdict, reading.placement, self._grid.pitch
        zones = tuple(where.zone[0 : where.zones])
        bearing = Bearing(
            self._grid.tangents[zones[0]] + pitch * np.array(list(where.bearing.mean)),
            pitch**2 * np.array(list(where.bearing.variance)),
        )
        # No residual is below the quantisation noise.
        amplitude = max(where.amplitude, self._sensor.signal_step / math.sqrt(12))
        return Detection(
            id=read.id,
            stamp_ns=origin_ns + round(where.time_s * 1e9),
            start_ns=origin_ns + round(read.transmission.start_s * 1e9),
            end_ns=where.end_ns,
            place=place(bearing, where.range_m, math.sqrt(where.range_variance)),
            snr_db=20 * math.log10(amplitude / math.sqrt(where.noise)),
            evidence=read.evidence,
            decision_margin=read.margin,
            bit_period_s=read.transmission.bit_s,
            score=where.score,
            likelihood=where.likelihood,
            corrected_bits=where.corrected_bits,
            packets=read.packets,
            zones=zones,
        )


def _track(seen: Any, stamp_ns: int, origin_ns: int) -> Track:
    """Return a track of the core, whose times are since an origin."""
    bearing = Bearing(np.array([*seen.tangent]), np.array([*seen.tangent_variance]))
    where = place(bearing, seen.range_m, math.sqrt(seen.range_variance))
    direction = where.position_m / seen.range_m
    along = direction[:, None] * direction
    return Track(
        id=seen.id,
        stamp_ns=stamp_ns,
        place=where,
        velocity=seen.range_rate * direction,
        velocity_covariance=(seen.range_rate_variance - _ACROSS_M_S**2) * along + _ACROSS,
        presence=seen.log_odds,
        first_ns=origin_ns + round(seen.first_s * 1e9),
        last_ns=seen.last_ns,
    )


def core_sensor(sensor: SensorModel, grid: ZoneGrid) -> Any:
    """Return the core's struct of a sensor with these zones."""
    meaning = np.full(256, lib.RL_INVALID)
    meaning[list(sensor.valid)] = lib.RL_VALID
    meaning[list(sensor.nothing)] = lib.RL_NO_TARGET
    meaning[list(sensor.faint)] = lib.RL_LOW_SIGNAL
    other = {'field_of_view', 'noise', 'valid', 'nothing', 'faint'}
    fields = {
        'rows': grid.rows,
        'columns': grid.columns,
        'zone_pitch': grid.pitch,
        'z_per_range': grid.z_per_range.tolist(),
        'meaning': meaning.tolist(),
        **{f'noise_{part}': value for part, value in vars(sensor.noise).items()},
        **{name: value for name, value in vars(sensor).items() if name not in other},
    }
    return ffi.new('struct rl_sensor *', fields)
