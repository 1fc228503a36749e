# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The detector that weighs its evidence: a search, then the same tests whatever the search.

Samples (`window`) of zones that modulate (`activity`) are cut into soft bits (`soft_bits`), a
search (`search`, `fold`) names packets that may be there, an exact fit (`fit`) tells how well they
are, other zones that see the same add to it, and a packet is read if

* chance makes such a correlation less often than the budget of false IDs allows,
* what it leaves over is no more than the sensor's noise,
* its samples hold two levels, in all parts of the packet (`coherence`), and
* no other ID explains them nearly as well (`rivals`).

`judge` applies these tests, and `report` says where and when.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE
from retrolidar_ros.detector.activity import may_repeat, modulated
from retrolidar_ros.detector.budget import granted_chances
from retrolidar_ros.detector.candidates import Candidates
from retrolidar_ros.detector.detection import Detection, DetectorCounts, check_grid
from retrolidar_ros.detector.evidence import NoiseLaw, NoiseScale, correlation_threshold
from retrolidar_ros.detector.fold import FoldSearch
from retrolidar_ros.detector.judge import Judge, Reading
from retrolidar_ros.detector.report import detection_of
from retrolidar_ros.detector.search import PACKET_SAMPLES, Demand, Search
from retrolidar_ros.detector.soft_bits import SILENT_BITS
from retrolidar_ros.detector.starts import EIGHTHS, Starts
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.window import Samples, SampleWindow
from retrolidar_ros.detector.words import WordBank
from retrolidar_ros.frame import Frame, Recording, ZoneGrid
from retrolidar_ros.markers import MARKER_SIZE_M

# Bits between two looks for starts, and for any stretch of a repeating packet.
_TURN_BITS = 8
# Such turns between two looks at the same stretch of several packets.
_SEVERAL_TURNS = 4
# Frames that are looked at together where there are many.
_BLOCK = 16
# A packet that ended in a gap is found after it, if the gap is no longer than this.
_LONGEST_GAP_BITS = 16


class EvidenceDetector:
    """Reads markers in all zones at once, frame by frame or many frames at a time."""

    def __init__(
        self,
        grid: ZoneGrid,
        search: Search,
        bank: WordBank,
        *,
        bit_period_s: float,
        false_ids_per_hour: float,
        folds: Sequence[int],
        noise: NoiseLaw,
        sizes_m: Mapping[int, float],
    ) -> None:
        """Prepare for frames of `grid`.

        Parameters
        ----------
        grid : ZoneGrid
        search : Search
            What finds packets that have just ended.
        bank : WordBank
            The packets that may come.
        bit_period_s : float
            How long a marker holds a bit [s].
        false_ids_per_hour : float
            What noise alone may make, over all zones.
        folds : sequence of int
            How many packets of a repeating marker are combined, rising; each is read from any bit.
        noise : NoiseLaw
            Of the sensor.
        sizes_m : mapping
            Edges of markers by their IDs [m], where they are not of the usual size.
        """
        self.counts = DetectorCounts()
        self._sizes_m = sizes_m
        self._grid = grid
        self._bit_s = bit_period_s
        self._sample_s = bit_period_s / 2
        self._search = search
        self._folds = folds
        self._fold_search = FoldSearch(bank, bit_period_s)
        self._dark_law = self._law = noise
        self.noise = NoiseScale(noise)
        """Of the sensor, as it has been learnt so far."""
        most_packets = max([1, *folds])
        self._judge = Judge(
            bank, grid, noise, max_packets=most_packets, false_ids_per_hour=false_ids_per_hour
        )
        self.chance = granted_chances(
            false_ids_per_hour,
            zones=grid.zones,
            words=len(bank.ids),
            bit_s=bit_period_s,
            hypotheses_a_sample=search.hypotheses_a_sample,
            fold_bits={
                fold: _TURN_BITS if fold == 1 else _SEVERAL_TURNS * _TURN_BITS for fold in folds
            },
        )
        """What noise is granted with each hypothesis, by packets folded, 0 for those just ended."""
        longest = round(1.03 * PACKET_SAMPLES * most_packets) + 2 * SILENT_BITS
        self._window = SampleWindow(grid.zones, longest + _BLOCK + 8, bit_period_s)
        self._all_zones = np.arange(grid.zones)
        self._starts = Starts(grid.zones, bit_period_s)
        self._longest_gap_ns = round(PACKET_BITS * bit_period_s * 1e9)
        self._free_s = np.full(grid.zones, -np.inf)
        self._searched_s = -np.inf
        self._ambient: NDArray[np.float32] = np.zeros(grid.zones, dtype=np.float32)
        self._last_start_s: dict[int, float] = {}
        self._last_ns = 0

    def update(self, frame: Frame) -> list[Detection]:
        """Take the next frame; return the detections that became certain with it.

        Raises
        ------
        ValueError
            If the frame has another zone grid than the detector.
        """
        check_grid(frame.grid, self._grid)
        if frame.stamp_ns == self._last_ns and len(self._window):
            return []
        self._begin_after_jump(frame.stamp_ns)
        self._ambient = frame.ambient
        self._window.append(
            np.array([frame.stamp_ns]), frame.signal[None], frame.distance[None], frame.status[None]
        )
        return self._look(1)

    def update_all(self, recording: Recording) -> list[Detection]:
        """Take many frames, at less cost than one after the other.

        Raises
        ------
        ValueError
            If the frames have another zone grid than the detector.
        """
        check_grid(recording.grid, self._grid)
        step_ns = np.diff(recording.stamp_ns, prepend=np.int64(self._last_ns))
        changed = step_ns != 0
        changed[:1] |= not len(self._window)
        new = np.flatnonzero(changed)
        jumps = np.flatnonzero((step_ns[new] < 0) | (step_ns[new] > self._longest_gap_ns))
        edges = np.union1d(np.concatenate([jumps, [len(new)]]), np.arange(0, len(new), _BLOCK))
        detections = []
        for first, last in itertools.pairwise(edges.tolist()):
            rows = new[first:last]
            self._begin_after_jump(int(recording.stamp_ns[rows[0]]))
            self._window.append(
                recording.stamp_ns[rows],
                recording.signal[rows],
                recording.distance[rows],
                recording.status[rows],
            )
            self._ambient = recording.ambient[rows[-1]]
            self._last_ns = int(recording.stamp_ns[rows[-1]])
            detections += self._look(len(rows))
        return detections

    def _begin_after_jump(self, stamp_ns: int) -> None:
        """Forget what came before, where the time goes back or leaves out a packet."""
        step_ns = stamp_ns - self._last_ns
        self._last_ns = stamp_ns
        if len(self._window) and 0 < step_ns <= self._longest_gap_ns:
            return
        self._window.clear(stamp_ns)
        self._starts.clear()
        self._free_s[:] = -np.inf
        self._searched_s = -np.inf
        self._last_start_s.clear()

    def _look(self, frames: int) -> list[Detection]:
        """Look for what became certain with the last frames."""
        self.counts.impossible = self._window.impossible
        last_s = float(self._window.last(1).end_s[0])
        from_s, self._searched_s = self._searched_s, last_s
        if not np.isfinite(from_s):
            self._adapt_to_light()
            return []
        packet_s = PACKET_BITS * self._bit_s
        if math.floor(last_s / packet_s) != math.floor(from_s / packet_s):
            self._adapt_to_light()
            self.noise.learn(self._window.last(PACKET_SAMPLES))
        turn = math.floor(last_s / (_TURN_BITS * self._bit_s))
        new_turn = turn != math.floor(from_s / (_TURN_BITS * self._bit_s))
        if new_turn:
            self._find_starts(last_s)
        readings = self._ended(from_s, last_s, frames)
        if self._folds and new_turn:
            readings += self._folded(turn, last_s)
        return [
            detection for reading in readings if (detection := self._published(reading)) is not None
        ]

    def _adapt_to_light(self) -> None:
        """Expect the noise that belongs to the ambient light of the newest frame."""
        ambient = float(np.median(self._ambient))
        if math.isfinite(ambient):
            self._law = self._dark_law.lit(max(ambient, 0.0))
            self.noise.law = self._judge.law = self._law

    def _find_starts(self, last_s: float) -> None:
        """Look for preambles, many frames at once; their packets end long after."""
        since_s = last_s - self._starts.looked_s + len(PREAMBLE) * self._bit_s
        samples = self._window.last(math.ceil(since_s / self._sample_s) + 2)
        view = View.of(samples, self._all_zones)
        self._starts.look(view, last_s, self._law, self.noise.value)

    def _ended(self, from_s: float, last_s: float, frames: int) -> list[Reading]:
        """Look for packets that have ended since the last look."""
        eighth_s = self._bit_s / EIGHTHS
        # After a gap, what ended in it is still found.
        first = math.floor(max(from_s, last_s - _LONGEST_GAP_BITS * self._bit_s) / eighth_s) + 1
        last = math.floor(last_s / eighth_s)
        if last < first:
            return []
        credible = self._starts.ended(first, last)
        zones = np.flatnonzero(credible.any(axis=0))
        if not len(zones):
            return []
        bits = PACKET_BITS + SILENT_BITS + (last - first) / EIGHTHS
        samples = self._window.last(math.ceil(2 * bits) + 4)
        zones = zones[modulated(samples, zones, frames, self.noise)]
        if not len(zones):
            return []
        view = View.of(samples, zones)
        candidates = self._search.ended(
            view, np.arange(first, last + 1) * eighth_s, credible[:, zones], self._demand(0, view)
        )
        return self._judged(candidates, samples, view, 0)

    def _folded(self, turn: int, last_s: float) -> list[Reading]:
        """Look at any stretch, of one packet's length and of several, in zones that may repeat.

        A single packet's length is looked at every turn. Several are as soon as a zone has so
        many samples, and then every fourth turn; the more there are, the surer.
        """
        readings = []
        first_s = float(self._window.first_s)
        for fold in reversed(self._folds):
            reach_s = (1.01 * PACKET_BITS * fold + 1) * self._bit_s
            since_s = np.maximum(self._free_s - 2 * self._bit_s, first_s)
            ready = since_s <= last_s - reach_s
            if fold > 1:
                waited = since_s > last_s - reach_s - _TURN_BITS * self._bit_s
                ready &= waited | ((self._all_zones + turn) % _SEVERAL_TURNS == 0)
            zones = np.flatnonzero(ready)
            if not len(zones):
                continue
            samples = self._window.last(math.ceil(1.02 * PACKET_SAMPLES * fold) + 4)
            zones = zones[may_repeat(samples, zones, self.noise)]
            if not len(zones):
                continue
            view = View.of(samples, zones)
            candidates = self._fold_search.folded(view, last_s, fold, self._demand(fold, view))
            readings += self._judged(candidates, samples, view, fold)
        return readings

    def _demand(self, fold: int, view: View) -> Demand:
        """Return what noise must not reach; `fold` is 0 for packets that have just ended."""
        threshold = correlation_threshold(PACKET_SAMPLES * max(1, fold), self.chance[fold])
        return Demand(threshold, self.noise.variance(view.mean))

    def _judged(
        self, candidates: Candidates | None, samples: Samples, view: View, fold: int
    ) -> list[Reading]:
        """Judge candidates whose zones are those of a view."""
        if candidates is None:
            return []
        zone = view.zones[candidates.zone]
        candidates = candidates._replace(zone=zone)
        # A packet that was read is not read again from samples of its own.
        first_s = candidates.start_s if fold == 0 else candidates.begin_s
        new = first_s >= self._free_s[zone] - 1.5 * self._bit_s
        if not new.any():
            return []
        candidates = candidates.at(new)
        self.counts.candidates += len(candidates.zone)
        everything = View.of(samples, self._all_zones)
        readings = self._judge.judge(
            candidates, everything, self.chance[fold], self.noise.value, self.counts.rejected
        )
        self.counts.accepted += len(readings)
        for reading in readings:
            # What comes after the last frame that was read whole is free to be read.
            start_s, packet_s = reading.fit.start_s[0], PACKET_BITS * reading.fit.bit_s[0]
            ended = (reading.candidate.end_s[0] - start_s) / packet_s if fold else 1.0
            end_s = float(start_s + max(math.floor(ended + 0.02), 1) * packet_s)
            seen = list(reading.zones)
            self._free_s[seen] = np.maximum(self._free_s[seen], end_s)
        return readings

    def _published(self, reading: Reading) -> Detection | None:
        """Return the detection of a reading; None if another zone has said it already."""
        identity = int(reading.candidate.ids[0])
        start_s = float(reading.fit.start_s[0])
        half_packet_s = PACKET_BITS * float(reading.fit.bit_s[0]) / 2
        if abs(start_s - self._last_start_s.get(identity, -np.inf)) < half_packet_s:
            return None
        samples = self._window.last(len(reading.fit.light[0]))
        detection = detection_of(
            reading,
            samples,
            self._window.origin_ns,
            self._grid,
            self._sizes_m.get(identity, MARKER_SIZE_M),
        )
        if detection is None:
            self.counts.rejected['distance'] += 1
        else:
            self._last_start_s[identity] = start_s
        return detection
