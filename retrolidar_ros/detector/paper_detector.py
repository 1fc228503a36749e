# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's detector (§3.5): likelihood of the preamble, arg max, threshold, Golay, mean range.

Where the paper leaves something open, this module decides:

A free-running stream
    The paper looks for one start within t_wake of a query. Here a zone whose likelihood passes
    the threshold opens a candidate, which a higher one replaces before its packet has ended. The
    search goes on with the starts whose preambles end later; they may lie in the packet's last
    seven bits, or a stream that was taken up at a wrong start would always be taken up there.
Ties of the likelihood
    The earliest start wins.
DC offset
    Taken from a packet's length of samples before the start, or at least four, by `silent_level`,
    whether a marker was silent then or not. It is held while a candidate is open.
Abnormal frames
    "No target" is one of them, so a marker without a background is not read: its bright level
    is held through its dark bits. Before its first normal sample a zone has the same signal.
Lost frames
    Samples repeat the previous one, as for abnormal frames. Frames that follow each other are
    successive samples, however long the period really is.
Sign of c
    A marker's dark bits make it negative, but l has only its square.
IDs
    The codewords of 0 and 4095 are constant, as any step of the signal is: they are rejected. So
    are unregistered IDs, after decoding; the search does not use the list.
Range
    The mean of the distances measured during the packet, of any target.
Several zones
    Each zone reads alone. Zones that read the same ID with the same frame make one detection,
    placed in the zone with the largest modulation; one that ends the packet later adds nothing.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector import paper_stages
from retrolidar_ros.detector.detection import (
    Candidate,
    Detection,
    DetectorCounts,
    Thresholds,
    Track,
    check_grid,
    place,
    zone_bearing,
)
from retrolidar_ros.detector.paper_stages import PACKET_SAMPLES, PREAMBLE_SAMPLES, SAMPLES_PER_BIT
from retrolidar_ros.marker.code import PREAMBLE, RESERVED_IDS, decode
from retrolidar_ros.sensor.frame import Frame, Recording, ZoneGrid, valid_samples
from retrolidar_ros.sensor.model import VL53L8CX

# The paper does not give its threshold. With this one the bare wall of the reference scene shows
# false starts about as often as paper Fig. 8c has them; a higher one reads less far.
LIKELIHOOD_THRESHOLD = 0.38
_MIN_HISTORY = 4
_MIN_DISTANCES = 2
_RESOLUTION_M = VL53L8CX.distance_step_m / np.sqrt(12)


class LastSamples:
    """The last samples of all zones, oldest first."""

    def __init__(self, zones: int, length: int, frame_period_s: float) -> None:
        """Keep `length` samples of `zones` zones taken every `frame_period_s`."""
        self.count = 0  # samples taken since the start, gaps included
        self.impossible = 0  # samples so far that `valid_samples` calls impossible
        self.signal = np.zeros((length, zones))  # [kcps/SPAD]
        self.distance = np.full((length, zones), np.nan)  # [m], NaN where none was measured
        self.stamp_ns = np.zeros(length, dtype=np.int64)
        self._period_ns = frame_period_s * 1e9
        self._seen = np.zeros(zones, dtype=bool)

    def push(self, frame: Frame) -> Iterator[tuple[int, int]]:
        """Append a frame, and before it what a gap in the stamps has lost, sample by sample.

        Abnormal samples repeat the zone's previous signal (paper §3.5), and so do those of lost
        frames, whose number the stamps give: a frame half a period early or late is still the
        next. Where the stamps go back or leave a gap as long as all that is kept, the samples
        start again. The same stamp is the same frame again, and makes no sample.

        Yields how many samples there are after each one, and the time of the last frame up to it
        [ns].
        """
        normal, impossible = valid_samples(frame.signal, frame.distance, frame.status)
        previous, last_ns = self.signal[-1].copy(), int(self.stamp_ns[-1])
        if self.count and frame.stamp_ns == last_ns:
            return
        self.impossible += impossible
        steps = max(1, round((frame.stamp_ns - last_ns) / self._period_ns))
        if self.count == 0 or frame.stamp_ns < last_ns or steps > len(self.signal):
            self.count = 0
            steps = 1
            self._seen[:] = False
        first_seen = normal & ~self._seen
        if first_seen.any():
            # Before its first normal sample a zone is taken to have been as bright as then: a
            # rise from nothing would look like the end of a dark bit.
            self.signal[:, first_seen] = frame.signal[first_seen]
            previous[first_seen] = frame.signal[first_seen]
            self._seen |= first_seen
        for step in range(1, steps):
            self._append(previous, np.nan, last_ns + round(step * self._period_ns))
            yield self.count, last_ns
        signal = np.where(normal, frame.signal, previous)
        distance = np.where(normal, frame.distance, np.nan)
        self._append(signal, distance, frame.stamp_ns)
        yield self.count, frame.stamp_ns

    def _append(
        self, signal: NDArray[np.floating], distance: NDArray[np.floating] | float, stamp_ns: int
    ) -> None:
        self.count += 1
        for kept in (self.signal, self.distance, self.stamp_ns):
            kept[:-1] = kept[1:]
        self.signal[-1], self.distance[-1], self.stamp_ns[-1] = signal, distance, stamp_ns


class PaperDetector:
    """Reads markers as the paper does, in all zones at once."""

    def __init__(
        self,
        grid: ZoneGrid,
        *,
        bit_period_s: float,
        likelihood_threshold: float,
        registered_ids: NDArray[np.int64],
    ) -> None:
        """Prepare for frames of `grid`; parameters as of `create_detector`."""
        self.candidates: Sequence[Candidate] = ()
        self.thresholds: Thresholds | None = None
        self.counts = DetectorCounts()
        self._grid = grid
        self._threshold = likelihood_threshold
        self._registered_ids = set(registered_ids.tolist())
        # A sample's stamp is the middle of its exposure, which began half a sample earlier.
        self._half_sample_ns = round(bit_period_s * 1e9 / SAMPLES_PER_BIT / 2)
        self._half_packet_ns = bit_period_s * 1e9 * PACKET_SAMPLES / SAMPLES_PER_BIT / 2
        self._samples = LastSamples(
            grid.zones, PREAMBLE_SAMPLES + PACKET_SAMPLES, bit_period_s / SAMPLES_PER_BIT
        )
        self._begin()

    def _begin(self) -> None:
        self._last_start_ns: dict[int, int] = {}
        zones = self._grid.zones
        self._open = np.zeros(zones, dtype=bool)
        self._likelihood = np.zeros(zones)
        self._start = np.zeros(zones, dtype=np.int64)
        self._c = np.zeros(zones)
        self._d = np.zeros(zones)

    def update(self, frame: Frame) -> list[Detection]:
        """Take the next frame; return the detections that became certain with it."""
        check_grid(frame.grid, self._grid)
        detections = []
        for count, stamp_ns in self._samples.push(frame):
            if count == 1:
                self._begin()
            detections += self._advance(count, stamp_ns)
        self.counts.impossible = self._samples.impossible
        return detections

    def update_all(self, recording: Recording) -> list[Detection]:
        """Take many frames, one after the other."""
        return [detection for frame in recording for detection in self.update(frame)]

    def follow(self, frame: Frame) -> list[Track]:
        """Return no tracks: the paper follows no markers."""
        return []

    def _advance(self, count: int, stamp_ns: int) -> list[Detection]:
        """Judge the start whose preamble ends with the newest of `count` samples."""
        start = count - PREAMBLE_SAMPLES
        if start < _MIN_HISTORY:
            return []
        idle = np.flatnonzero(~self._open)
        history, preamble = np.split(self._samples.signal, [-PREAMBLE_SAMPLES])
        self._d[idle] = paper_stages.silent_level(history[-start:, idle])
        fit = paper_stages.fit_preamble(preamble, self._d)
        likely = fit.likelihood >= self._threshold
        if likely.any():
            better = likely & (fit.likelihood > self._likelihood)
            self._likelihood[better] = fit.likelihood[better]
            self._start[better] = start
            self._c[better] = fit.c[better]
            self._open |= better
        ended = np.flatnonzero(self._open & (self._start + PACKET_SAMPLES == count))
        if not len(ended):
            return []
        detections = self._read(ended, stamp_ns)
        self._open[ended] = False
        self._likelihood[ended] = 0.0
        return detections

    def _read(self, zones: NDArray[np.intp], stamp_ns: int) -> list[Detection]:
        signal = self._samples.signal[-PACKET_SAMPLES:, zones]
        bits = paper_stages.threshold_bits(signal, self._d[zones], self._c[zones])
        ids, corrected_bits = decode(bits[:, len(PREAMBLE) :])
        reserved = np.isin(ids, RESERVED_IDS)
        readable = (ids >= 0) & ~reserved
        self.counts.candidates += len(zones)
        self.counts.rejected['golay'] += int(np.count_nonzero(ids < 0))
        self.counts.rejected['reserved'] += int(np.count_nonzero(reserved))
        start_ns = int(self._samples.stamp_ns[-PACKET_SAMPLES]) - self._half_sample_ns
        detections = []
        for identity in np.unique(ids[readable]).tolist():
            read = np.flatnonzero(ids == identity)
            if identity not in self._registered_ids:
                self.counts.rejected['unregistered'] += len(read)
                continue
            fit = paper_stages.fit_packets(signal[:, read], ids[read])
            order = np.argsort(-np.abs(fit.amplitude), kind='stable')
            best = order[0]
            zone = int(zones[read[best]])
            distance = self._samples.distance[-PACKET_SAMPLES:, zone]
            measured = distance[np.isfinite(distance)]
            if len(measured) < _MIN_DISTANCES:
                self.counts.rejected['distance'] += len(read)
                continue
            self.counts.accepted += len(read)
            if self._is_known(identity, start_ns):
                continue
            deviation = np.hypot(measured.std(ddof=1), _RESOLUTION_M) / np.sqrt(len(measured))
            per_depth = 1 / float(self._grid.z_per_range[zone])
            detections.append(
                Detection(
                    id=identity,
                    stamp_ns=(start_ns + self._half_sample_ns + stamp_ns) // 2,
                    start_ns=start_ns,
                    end_ns=stamp_ns,
                    place=place(
                        zone_bearing(zone, self._grid),
                        float(measured.mean()) * per_depth,
                        float(deviation) * per_depth,
                    ),
                    snr_db=float(fit.snr_db[best]),
                    evidence=math.nan,
                    decision_margin=math.nan,
                    bit_period_s=2e-9 * SAMPLES_PER_BIT * self._half_sample_ns,
                    score=float(max(fit.score[best], 0.0)),
                    likelihood=float(self._likelihood[zone]),
                    corrected_bits=int(corrected_bits[read[best]]),
                    packets=1,
                    zones=tuple(zones[read[order]].tolist()),
                )
            )
        return detections

    def _is_known(self, identity: int, start_ns: int) -> bool:
        """Return whether another zone has already read the packet of about this start."""
        last_ns = self._last_start_ns.get(identity)
        if last_ns is not None and abs(start_ns - last_ns) < self._half_packet_ns:
            return True
        self._last_start_ns[identity] = start_ns
        return False
