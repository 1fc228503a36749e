# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's detector (§3.5): likelihood of the preamble, arg max, threshold, Golay, mean range.

Where the paper leaves something open, this module decides:

A free-running stream
    The paper looks for one start within t_wake of a query. Here a zone whose likelihood passes
    the threshold opens a candidate, and t_wake is what remains of its packet: a higher
    likelihood before the packet has ended replaces the candidate. The arg max is thus known
    with the last sample of the packet, and the search goes on after it.
Ties of the likelihood
    The earliest start wins.
DC offset
    The mean of a packet's length of samples before the start, where the zone was silent for
    that long; otherwise the bright level among them. It is held while a candidate is open.
Lost frames
    Samples repeat the previous one, as for abnormal frames.
Range
    The mean of all measured distances of the packet, whatever the target was.
Several zones
    Each zone reads alone. Zones that read the same ID with the same frame make one detection,
    placed in the zone with the largest modulation; a zone that ends the same packet later
    than that adds nothing.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import BIT_PERIOD_S, PREAMBLE, decode
from retrolidar_ros.detector.baseline import bright_level, silent_level
from retrolidar_ros.detector.demodulation import PACKET_SAMPLES, fit_packets, threshold_bits
from retrolidar_ros.detector.detection import Detection, DetectorCounts
from retrolidar_ros.detector.place import place_in_zone
from retrolidar_ros.detector.preamble import PREAMBLE_SAMPLES, SAMPLES_PER_BIT, fit_preamble
from retrolidar_ros.detector.samples import SampleRing
from retrolidar_ros.frame import Frame, ZoneGrid

LIKELIHOOD_THRESHOLD = 0.25
_LEAST_HISTORY = 4


class PaperDetector:
    """Reads markers as the paper does, in all zones at once."""

    def __init__(
        self,
        grid: ZoneGrid,
        *,
        bit_period_s: float = BIT_PERIOD_S,
        likelihood_threshold: float = LIKELIHOOD_THRESHOLD,
    ) -> None:
        """Prepare for frames of `grid`, of markers that send a bit every `bit_period_s`."""
        self.counts = DetectorCounts()
        self._grid = grid
        self._threshold = likelihood_threshold
        self._half_packet_ns = bit_period_s * 1e9 * PACKET_SAMPLES / SAMPLES_PER_BIT / 2
        self._ring = SampleRing(
            grid.zones, PREAMBLE_SAMPLES + PACKET_SAMPLES, bit_period_s / SAMPLES_PER_BIT
        )
        self._last_start_ns: dict[int, int] = {}
        self._begin()

    def _begin(self) -> None:
        """Forget all candidates; a zone counts as transmitting until it has been silent."""
        zones = self._grid.zones
        self._open = np.zeros(zones, dtype=bool)
        self._likelihood = np.zeros(zones)
        self._start = np.zeros(zones, dtype=np.int64)
        self._free_from = np.zeros(zones, dtype=np.int64)
        self._busy_until = np.full(zones, -1)
        self._c = np.zeros(zones)
        self._d = np.zeros(zones)

    def update(self, frame: Frame) -> list[Detection]:
        """Take the next frame; return the detections that became certain with it.

        Raises
        ------
        ValueError
            If the frame has another zone grid than the detector.
        """
        if frame.grid != self._grid:
            raise ValueError(
                f'a frame of {frame.grid.rows}x{frame.grid.columns} zones came to a detector '
                f'for {self._grid.rows}x{self._grid.columns}'
            )
        steps = self._ring.push(frame)
        if steps == 0:
            self._begin()
        detections = []
        # The samples of a gap become known together; each of them still is a possible start.
        for until in range(steps - 1, -1, -1):
            detections += self._advance(until)
        return detections

    def _advance(self, until: int) -> list[Detection]:
        """Judge the start whose preamble ends `until` samples before the newest one."""
        now = self._ring.count - 1 - until
        start = now + 1 - PREAMBLE_SAMPLES
        if start < _LEAST_HISTORY:
            return []
        self._update_offset(start, until)
        fit = fit_preamble(self._ring.signal(PREAMBLE_SAMPLES, until), self._d)
        likely = fit.likelihood >= self._threshold
        if likely.any():
            self._busy_until[likely] = now
            better = likely & (fit.likelihood > self._likelihood) & (start >= self._free_from)
            self._likelihood[better] = fit.likelihood[better]
            self._start[better] = start
            self._c[better] = fit.c[better]
            self._open |= better
        ended = np.flatnonzero(self._open & (self._start + PACKET_SAMPLES == now + 1))
        if not len(ended):
            return []
        detections = self._read(ended, until)
        self._open[ended] = False
        self._likelihood[ended] = 0.0
        self._busy_until[ended] = now
        self._free_from[ended] = now + 1
        return detections

    def _update_offset(self, start: int, until: int) -> None:
        """Take d from the samples before `start`, where no candidate holds it."""
        history = min(start, PACKET_SAMPLES)
        signal = self._ring.signal(history, until + PREAMBLE_SAMPLES)
        silent = self._busy_until < start - PACKET_SAMPLES
        np.copyto(self._d, silent_level(signal), where=silent & ~self._open)
        talking = np.flatnonzero(~silent & ~self._open)
        if len(talking):
            self._d[talking] = bright_level(signal[:, talking])

    def _read(self, zones: NDArray[np.intp], until: int) -> list[Detection]:
        """Demodulate and decode the packets that have just ended in some zones."""
        signal = self._ring.signal(PACKET_SAMPLES, until)[:, zones]
        bits = threshold_bits(signal, self._d[zones], self._c[zones])
        ids, corrected_bits = decode(bits[:, len(PREAMBLE) :])
        readable = ids >= 0
        self.counts.candidates += len(zones)
        self.counts.rejected['golay'] += int(np.count_nonzero(~readable))
        stamp_ns = self._ring.stamp_ns(PACKET_SAMPLES, until)
        detections = []
        for identity in np.unique(ids[readable]).tolist():
            read = np.flatnonzero(ids == identity)
            fit = fit_packets(signal[:, read], ids[read])
            order = np.argsort(-np.abs(fit.amplitude), kind='stable')
            best = order[0]
            self.counts.accepted += len(read)
            if self._is_known(identity, int(stamp_ns[0])):
                continue
            distance = self._ring.distance(PACKET_SAMPLES, until)[:, zones[read[best]]]
            measured = distance[np.isfinite(distance)]
            if not len(measured):
                continue
            detections.append(
                Detection(
                    id=identity,
                    stamp_ns=int(stamp_ns[-1]),
                    start_ns=int(stamp_ns[0]),
                    place=place_in_zone(
                        int(zones[read[best]]),
                        float(measured.mean()),
                        float(measured.std() / np.sqrt(len(measured))),
                        self._grid,
                    ),
                    snr_db=float(fit.snr_db[best]),
                    score=float(max(fit.score[best], 0.0)),
                    likelihood=float(self._likelihood[zones[read[best]]]),
                    corrected_bits=int(corrected_bits[read[best]]),
                    packets=1,
                    zones=tuple(zones[read[order]].tolist()),
                )
            )
        return detections

    def _is_known(self, identity: int, start_ns: int) -> bool:
        """Tell whether another zone has already read the packet that began about then."""
        last_ns = self._last_start_ns.get(identity)
        if last_ns is not None and abs(start_ns - last_ns) < self._half_packet_ns:
            return True
        self._last_start_ns[identity] = start_ns
        return False
