# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The default detector: the core searches and decides by one likelihood.

The core (`core/src/retrolidar_detector.h`) gets frames and returns readings, which are placed here
and become detections.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.core import ffi, lib
from retrolidar_ros.detector.budget import demands
from retrolidar_ros.detector.detection import Detection, DetectorCounts, check_grid
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.detector.placement import USUAL, Optics, Placer
from retrolidar_ros.detector.reason import REASONS, Reason
from retrolidar_ros.marker.code import IDS, RESERVED_IDS, check_ids
from retrolidar_ros.marker.known_markers import MARKER_SIZE_M
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid

# Capacity in frames: eight packets at two frames a bit, or one at more than thirty.
_LEAST_HELD = 1100


class Candidate(NamedTuple):
    """A packet that was judged."""

    id: int
    zone: int
    """The zone, or from `zones` on the sum of zones, that was searched."""
    packets: int
    reason: Reason | None
    """Why it was refused; None if it was read."""
    start_ns: int
    bit_period_s: float
    evidence: float
    """[nats]; this and the next two are 0 if it was refused before they were computed."""
    word: float
    """Log likelihood of the best other sequence of bits less its own [nats]."""
    margin: float
    """[nats]"""


class _OneFrame:
    """Memory that the core takes one frame from."""

    def __init__(self, zones: int) -> None:
        self._stamp_ns = np.empty(1, dtype=np.int64)
        self._signal, self._distance, self._ambient = np.empty((3, zones), dtype=np.float32)
        self._status = np.empty(zones, dtype=np.uint8)
        self.pointers = (
            ffi.from_buffer('int64_t[]', self._stamp_ns),
            *(
                ffi.from_buffer('float[]', array)
                for array in (self._signal, self._distance, self._ambient)
            ),
            ffi.from_buffer('uint8_t[]', self._status),
        )

    def fill(self, frame: Frame) -> None:
        """Copy a frame."""
        self._stamp_ns[0] = frame.stamp_ns
        self._signal[:] = frame.signal
        self._distance[:] = frame.distance
        self._ambient[:] = frame.ambient
        self._status[:] = frame.status


class LikelihoodDetector:
    """Reads markers in all zones at once, frame by frame or many frames at a time."""

    def __init__(
        self,
        grid: ZoneGrid,
        *,
        bit_period_s: float,
        false_ids_per_hour: float,
        max_packets: int,
        registered_ids: ArrayLike | None,
        noise: NoiseLaw,
        sizes_m: Mapping[int, float],
        optics: Optics = USUAL,
    ) -> None:
        """Prepare for frames of `grid`.

        Parameters
        ----------
        grid : ZoneGrid
        bit_period_s : float
            How long a marker holds a bit, to 3 % [s].
        false_ids_per_hour : float
            Budget of false IDs, over all zones.
        max_packets : int
            How many packets of a repeating marker may be combined.
        registered_ids : array of int, optional
            The only IDs that are read.
        noise : NoiseLaw
            Of the sensor, to a factor of 8.
        sizes_m : mapping
            Edges of markers by their IDs [m]; others have the default size.
        optics : Optics
            Where this sensor departs from the usual one.
        """
        self.candidates: list[Candidate] = []
        """Candidates judged in the latest update."""
        self._grid = grid
        self._sizes_m = sizes_m
        self._unplaced = 0
        ids = usable_ids(registered_ids)
        self.demands = demands(
            false_ids_per_hour, zones=grid.zones, words=len(ids), bit_s=bit_period_s
        )
        settings = ffi.new(
            'struct rl_settings *',
            {
                'rows': grid.rows,
                'columns': grid.columns,
                'max_packets': max_packets,
                'kept': _LEAST_HELD,
                'bit_s': bit_period_s,
                'noise_floor': noise.floor,
                'noise_slope': noise.slope,
                'noise_ambient': noise.ambient,
                **self.demands._asdict(),
            },
        )
        numbers = ids.astype(np.uint16)
        core = lib.rl_detector_create(settings, ffi.from_buffer('uint16_t[]', numbers), len(ids))
        if core == ffi.NULL:
            raise MemoryError('no memory for the samples of the detector')
        self._core = ffi.gc(core, lib.rl_detector_destroy)
        self._frame = _OneFrame(grid.zones)
        self._placer = Placer(self._core, grid, optics)

    @property
    def counts(self) -> DetectorCounts:
        """Candidates by outcome so far."""
        counts = lib.rl_detector_counts(self._core)
        refused = {reason: counts.refused[number] for number, reason in REASONS.items()}
        refused[Reason.DISTANCE] = self._unplaced
        return DetectorCounts(
            candidates=counts.candidates,
            accepted=counts.accepted - self._unplaced,
            rejected=Counter({reason.value: count for reason, count in refused.items() if count}),
            impossible=counts.impossible,
            overloads=counts.overloads,
        )

    def update(self, frame: Frame) -> list[Detection]:
        """Take the next frame; return the detections that became certain with it.

        Raises
        ------
        ValueError
            If the frame has another zone grid than the detector.
        """
        check_grid(frame.grid, self._grid)
        self._frame.fill(frame)
        self.candidates = []
        lib.rl_detector_push(self._core, 1, *self._frame.pointers)
        return self._take() if lib.rl_detector_candidates(self._core) else []

    def update_all(self, recording: Recording) -> list[Detection]:
        """Take many frames, faster than one by one.

        Raises
        ------
        ValueError
            If the frames have another zone grid than the detector.
        """
        check_grid(recording.grid, self._grid)
        zones = self._grid.zones
        stamps = _pointer('int64_t[]', recording.stamp_ns, np.int64)
        values = (recording.signal, recording.distance, recording.ambient)
        arrays = [_pointer('float[]', array, np.float32) for array in values]
        statuses = _pointer('uint8_t[]', recording.status, np.uint8)
        detections: list[Detection] = []
        self.candidates = []
        taken, frames = 0, len(recording)
        while taken < frames:
            at = taken * zones
            taken += lib.rl_detector_push(
                self._core,
                frames - taken,
                stamps + taken,
                *(array + at for array in arrays),
                statuses + at,
            )
            if lib.rl_detector_candidates(self._core):
                detections += self._take()
        return detections

    def _take(self) -> list[Detection]:
        """Return the detections of the newest frame, and store the candidates."""
        held = lib.rl_detector_held(self._core)
        for index in range(lib.rl_detector_candidates(self._core)):
            judged = lib.rl_detector_candidate(self._core, index)
            reason = REASONS.get(judged.reason)
            self.candidates.append(
                Candidate(
                    id=judged.id,
                    zone=judged.source,
                    packets=judged.packets,
                    reason=reason,
                    start_ns=held.origin_ns + round(judged.start_s * 1e9),
                    bit_period_s=judged.bit_s,
                    evidence=judged.evidence,
                    word=judged.word,
                    margin=judged.margin,
                )
            )
        detections = []
        for index in range(lib.rl_detector_readings(self._core)):
            number = lib.rl_detector_reading(self._core, index).id
            size_m = self._sizes_m.get(number, MARKER_SIZE_M)
            detection = self._placer.place(index, held.origin_ns, size_m)
            if detection is None:
                self._unplaced += 1
            else:
                detections.append(detection)
        return detections


def usable_ids(registered_ids: ArrayLike | None) -> NDArray[np.int64]:
    """Return the usable IDs among the registered ones, ascending; all usable ones by default.

    Raises
    ------
    ValueError
        If one is impossible, or none is usable.
    """
    ids = np.arange(IDS) if registered_ids is None else np.unique(check_ids(registered_ids))
    ids = ids[~np.isin(ids, RESERVED_IDS)]
    if not len(ids):
        raise ValueError('registered_ids holds no usable ID (0 and 4095 cannot be read)')
    return ids


def _pointer(kind: str, values: NDArray[Any], dtype: type) -> Any:
    """Return a pointer to values, copied only if their layout is another."""
    return ffi.from_buffer(kind, np.ascontiguousarray(values, dtype=dtype))
