# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What turns a candidate into a reading, or says why not."""

from __future__ import annotations

import math
from collections import Counter
from typing import NamedTuple

import numpy as np

from retrolidar_ros.code import PACKET_BITS, packet
from retrolidar_ros.detector.candidates import Candidates
from retrolidar_ros.detector.coherence import coherent, erased_bits, hard_errors
from retrolidar_ros.detector.companions import Companions, combined, seeing
from retrolidar_ros.detector.evidence import (
    NoiseLaw,
    correlation_threshold,
    group_threshold,
    nats,
)
from retrolidar_ros.detector.fit import Fit, fit_candidates
from retrolidar_ros.detector.rivals import Rivals, Window
from retrolidar_ros.detector.search import PACKET_SAMPLES
from retrolidar_ros.detector.soft_bits import SILENT_BITS, Level
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.words import SHIFTS, WordBank
from retrolidar_ros.frame import Floats, ZoneGrid

# Share of a packet's changes between bright and dark that must not be erased.
_LEAST_CHANGES = 0.6
# Bits that may be erased: so many leave all words of a code of distance 8 apart. With more, lost
# frames in bursts made wrong IDs.
_MOST_ERASED_BITS = 7
# Most that a packet may leave over, as χ² per degree of freedom: of a true one it is 1.0 ± 0.2.
# With 2.0, markers with a bit period wrong by 5 % were read as other IDs.
MOST_RESIDUAL = 1.6
# Median of the bright samples less that of the dark ones, as a share of the fitted gain.
_LEAST_STEP = 0.5
USUAL_FALSE_IDS_PER_HOUR = 0.1
# How much likelier than its nearest rival a packet must be [nats]. Where more packets may come,
# one in ten thousand is the most that may be wrong; a marker at the limit of the reach is left to
# them, so few that are read at all are near that limit when the last ones have come.
_LEAD_OF_LONE = float(np.log(1e3))
_LEAD_OF_MORE_TO_COME = float(np.log(1e4))
_LEAD_OF_ALL = float(np.log(250))


class Tests(NamedTuple):
    """By how much a packet has passed, each beside its limit."""

    nats: float
    """Logarithm of the likelihood ratio against noise, all zones together."""
    least_nats: float
    lead: float
    """The same against the nearest other ID."""
    least_lead: float


class Reading(NamedTuple):
    """A packet that was read."""

    candidate: Candidates
    """One."""
    fit: Fit
    """Of the zones together."""
    zones: tuple[int, ...]
    """Strongest first."""
    corrected_bits: int
    tests: Tests


class _WindowBits(NamedTuple):
    """The soft bits of a window in which a packet was found."""

    edges_s: Floats
    """Where the bits begin, and the last one ends [s]."""
    phase: float
    """Of the bits in an exposure, 0 to 1."""
    level: Level
    """Of one hypothesis and zone."""
    row: Floats
    """Its soft bits, the packets on top of each other, shape (31,)."""


class Judge:
    """Fits candidates, lets zones that see the same one combine, and tests them."""

    def __init__(
        self,
        bank: WordBank,
        grid: ZoneGrid,
        law: NoiseLaw,
        *,
        max_packets: int,
        false_ids_per_hour: float,
    ) -> None:
        """Judge packets of `bank` that zones of `grid` with noise of `law` see.

        At most `max_packets` of them are combined. Whoever allows more `false_ids_per_hour` than
        usual is content with less of a lead over rivals, too.
        """
        self._max_packets = max_packets
        self._lenience = math.log(false_ids_per_hour / USUAL_FALSE_IDS_PER_HOUR)
        self._bank = bank
        self._rivals = Rivals(bank)
        self.law = law
        self._companions = Companions(grid)

    def judge(
        self,
        candidates: Candidates,
        everything: View,
        chance: float,
        noise_scale: float,
        rejected: Counter[str],
    ) -> list[Reading]:
        """Return what is read, the clearest first, and count what is not by its reason.

        Parameters
        ----------
        candidates : Candidates
            With zones of the sensor.
        everything : View
            Of all zones.
        chance : float
            How likely white noise may be to pass, for one packet in question.
        noise_scale : float
            How many times the variance of the noise law the sensor has.
        rejected : Counter
            Counted into.
        """
        fits = fit_candidates(
            candidates,
            everything.begin_s,
            everything.end_s,
            everything.signal[:, candidates.zone].T,
            everything.weight[:, candidates.zone].T,
            everything.ceiling[:, candidates.zone].T,
            self.law,
            noise_scale,
        )
        readings = []
        for index in np.argsort(-fits.nats, kind='stable').tolist():
            one = np.array([index])
            reading = self._test(
                candidates.at(one),
                Fit(*(field[one] for field in fits)),
                everything,
                chance,
                noise_scale,
            )
            if isinstance(reading, str):
                rejected[reading] += 1
            else:
                readings.append(reading)
        return readings

    def _test(
        self,
        candidate: Candidates,
        fit: Fit,
        everything: View,
        chance: float,
        noise_scale: float,
    ) -> Reading | str:
        """Return the reading, or why there is none."""
        zone = int(candidate.zone[0])
        if not fit.gain[0] > 0:
            return 'no modulation'
        told = fit.weight[0] > 0
        lit = fit.light[0][told] > 0.5
        changes = np.count_nonzero(np.diff(packet(candidate.ids[0]))) * candidate.packets[0]
        if np.count_nonzero(lit[1:] != lit[:-1]) < _LEAST_CHANGES * changes:
            # A single step is a packet of which nothing but an edge is left.
            return 'erased'
        parts, gains = self._companions.parts(zone, fit, everything, self.law, noise_scale)
        seen = seeing(zone, parts)
        view = everything.only(zone)
        if len(seen) > 1:
            view = combined(seen, gains, everything, self.law)
            candidate, fit = self._again(candidate, fit, view, noise_scale)
            parts, gains = self._companions.parts(zone, fit, everything, self.law, noise_scale)
        total = float(fit.nats[0]) if len(seen) == 1 else sum(parts[seer] for seer in seen)
        samples = int(fit.samples[0])
        least = float(nats(np.asarray(correlation_threshold(samples, chance)), np.asarray(samples)))
        least = group_threshold(least, len(seen))
        if total < least:
            return 'score'
        if fit.residual[0] > MOST_RESIDUAL:
            return 'residual'
        told = fit.weight[0] > 0
        light = fit.light[0]
        signal = view.signal[:, 0]
        bright, dark = signal[told & (light > 0.5)], signal[told & (light <= 0.5)]
        if not (len(bright) and len(dark)):
            return 'no modulation'
        if np.median(bright) - np.median(dark) < _LEAST_STEP * fit.gain[0]:
            return 'no modulation'
        if not coherent(candidate, fit, view):
            return 'incoherent'
        found = nats(np.concatenate([candidate.correlation, candidate.rival]), np.full(2, samples))
        margin, dark, presence = self._margin(candidate, fit, view)
        if erased_bits(presence) > _MOST_ERASED_BITS:
            return 'erased'
        if margin is None:
            return 'incomplete'
        lead = min(margin, float(found[0] - found[1]))
        least_lead = self._lead(candidate) - self._lenience
        if lead < least_lead:
            return 'ambiguous'
        order = sorted(seen, key=lambda seer: -gains[seer])
        errors = hard_errors(dark, packet(candidate.ids[0]))
        tests = Tests(total, least, lead, least_lead)
        return Reading(candidate, fit, tuple(order), errors, tests)

    def _lead(self, candidate: Candidates) -> float:
        """Return by how much a packet must be likelier than its nearest rival [nats]."""
        if not candidate.repeats[0] or self._max_packets == 1:
            return _LEAD_OF_LONE
        if candidate.packets[0] < self._max_packets:
            return _LEAD_OF_MORE_TO_COME
        return _LEAD_OF_ALL

    def _again(
        self, candidate: Candidates, fit: Fit, view: View, noise_scale: float
    ) -> tuple[Candidates, Fit]:
        """Look for the word once more, now that the zones are combined, and fit it."""
        edges_s, phase, _, row = self._window_bits(candidate, fit, view)
        rows = row[SHIFTS] if candidate.repeats[0] else row[None]
        phases = np.full(len(rows), phase)
        best = self._bank.best(rows, np.ones(len(rows)), phases, PACKET_SAMPLES)
        shift = int(best.correlation.argmax())
        start_s = edges_s[:1] + fit.bit_s * (shift - PACKET_BITS if shift > 0 else 0)
        candidate = candidate._replace(
            ids=best.ids[shift : shift + 1], start_s=start_s, bit_s=fit.bit_s
        )
        return candidate, fit_candidates(
            candidate,
            view.begin_s,
            view.end_s,
            view.signal.T,
            view.weight.T,
            view.ceiling.T,
            self.law,
            noise_scale,
        )

    def _margin(
        self, candidate: Candidates, fit: Fit, view: View
    ) -> tuple[float | None, Floats, Floats]:
        """Return the lead over the nearest rival [nats], the soft bits and their presence.

        No lead where the packet has not ended yet, or has ended before.
        """
        packets = int(candidate.packets[0])
        edges_s, phase, level, row = self._window_bits(candidate, fit, view)
        window = row
        before = SILENT_BITS if candidate.still[0] else 0
        begin_s = edges_s[0]
        if before:
            # The silence tells, too.
            edges_s = edges_s[0] + fit.bit_s[0] * np.arange(-before, PACKET_BITS + 1)
            soft = view.soft_bits(edges_s[None])
            phase = float(soft.phase[0])
            level = soft.steady(1)
            window = level.value[0, :, 0]
        presence = _folded(view.presence(edges_s), 1 if before else packets) / packets
        told = float(level.told[0, 0])
        first = before + round((fit.start_s[0] - begin_s) / fit.bit_s[0]) % PACKET_BITS
        margin = self._rivals.margin(
            Window(
                soft=window,
                energy=float(level.energy[0, 0]) * told / (2 * (len(edges_s) - 1)) * packets,
                phase=phase,
                samples=told,
                first=first,
                repeats=bool(candidate.repeats[0]),
                packets=packets,
                presence=presence,
            ),
            int(candidate.ids[0]),
        )
        return margin, np.roll(row, before - first), presence

    def _window_bits(self, candidate: Candidates, fit: Fit, view: View) -> _WindowBits:
        """Cut the window, without the silence, into the bits of the fit."""
        packets = int(candidate.packets[0])
        bit_s = fit.bit_s[0]
        first = fit.start_s[0]
        if candidate.repeats[0]:
            first += np.rint((candidate.begin_s[0] - first) / bit_s) * bit_s
        edges_s = first + bit_s * np.arange(PACKET_BITS * packets + 1)
        soft = view.soft_bits(edges_s[None])
        level = soft.drifting() if packets > 1 else soft.steady(1)
        return _WindowBits(
            edges_s, float(soft.phase[0]), level, _folded(level.value[0, :, 0], packets)
        )


def _folded(value: Floats, packets: int) -> Floats:
    """Lay packets on top of each other."""
    folded: Floats = value.reshape(packets, -1).sum(axis=0)
    return folded
