# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where packets may be: the methods' different ways to a start, a clock and a word."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE, WORD_BITS, decode
from retrolidar_ros.detector.candidates import Candidates, joined
from retrolidar_ros.detector.soft_bits import SILENT_BITS
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.words import WordBank
from retrolidar_ros.frame import Floats

PACKET_SAMPLES = 2 * PACKET_BITS
_STILL_SAMPLES = 2 * (PACKET_BITS + SILENT_BITS)
# Whoever has lost more of a packet than this has nothing to judge by.
LEAST_PRESENT = 0.45
# What the coarse templates of a search may miss of what an exact one explains.
COARSE = 0.94


class Demand(NamedTuple):
    """What a search asks of a candidate."""

    correlation: float
    """Least correlation of an exact fit."""
    noise: Floats
    """Variance that the sensor's noise has in each zone of the view, shape (zones,)."""

    @property
    def least(self) -> float:
        """Least coarse correlation of what the search returns."""
        return COARSE * self.correlation

    def least_correlation(self, energy: Floats, told: Floats) -> Floats:
        """Return the least coarse correlation for energies (hypotheses, zones).

        Apart from the least for evidence, what a packet leaves over must be noise, so the
        clearer a zone modulates the better a packet has to fit.
        """
        if self.correlation <= 0:
            return np.zeros_like(energy)
        noisy = 2.5 * self.noise * told / energy
        least: Floats = np.sqrt(np.maximum(self.least**2, 0.9 - noisy))
        return least


class Search(Protocol):
    """Finds packets in a view."""

    hypotheses_a_sample: float
    """How many independent ones it tries with each sample and zone, for every word.

    As measured on white noise: neither phases nor clocks next to each other are independent, and
    most places are never looked at, as there is no preamble.
    """

    def ended(
        self, view: View, end_s: Floats, credible: NDArray[np.bool_], demand: Demand
    ) -> Candidates | None:
        """Return packets that have just ended.

        Parameters
        ----------
        view : View
        end_s : array, shape (ends,)
            When they may have, on a grid of eighths of bits [s].
        credible : array of bool, shape (ends, zones)
            Whether there was a preamble at the time (`Starts`).
        demand : Demand
        """


class JointSearch:
    """Start, phase, clock and word together: the packet that explains the samples best."""

    hypotheses_a_sample = 0.8
    _SKEWS = np.array([0.0, -0.0067, 0.0067])
    _BITS = np.arange(PACKET_BITS + 1)

    def __init__(self, bank: WordBank, bit_s: float) -> None:
        """Look for the packets of `bank` with bits of about `bit_s`."""
        self._bank = bank
        self._bit_s = bit_s

    def ended(
        self, view: View, end_s: Floats, credible: NDArray[np.bool_], demand: Demand
    ) -> Candidates | None:
        """Return packets that have just ended, as `Search.ended`."""
        bit_s = np.tile(self._bit_s * (1 + self._SKEWS), len(end_s))
        ends_s = np.repeat(end_s, len(self._SKEWS))
        start_s = ends_s - PACKET_BITS * bit_s
        edges_s = start_s[:, None] + bit_s[:, None] * self._BITS
        maybe = np.repeat(credible, len(self._SKEWS), axis=0)
        silent_s = SILENT_BITS * self._bit_s
        soft = view.soft_bits(edges_s, silent_s)
        found = []
        for still in (False, True):
            level = soft.steady(0) if still else soft.drifting()
            samples = _STILL_SAMPLES if still else PACKET_SAMPLES
            energy = level.energy * level.told * (1 / samples)
            least = demand.least_correlation(level.energy, level.told)
            bound = self._bank.bound(level.value, samples, line=not still)
            good = bound > least * np.sqrt(energy)
            good &= level.told > LEAST_PRESENT * samples
            good &= maybe
            if not good.any():
                continue
            h, z = np.nonzero(good)
            best = self._bank.best(
                level.value[h, :, z], energy[h, z], soft.phase[h], samples, line=not still
            )
            found.append(
                Candidates(
                    zone=z,
                    ids=best.ids,
                    start_s=start_s[h],
                    bit_s=bit_s[h],
                    begin_s=start_s[h] - silent_s if still else start_s[h],
                    end_s=ends_s[h],
                    packets=np.ones(len(h), dtype=np.int64),
                    repeats=np.zeros(len(h), dtype=bool),
                    still=np.full(len(h), still),
                    correlation=best.correlation,
                    rival=np.zeros(len(h)),
                )
            )
        return joined(found, demand.least)


class StartSearch:
    """A start first, on the edge of a frame; then a word, by hard or by soft decision.

    Every start whose preamble is credible is read when its packet has ended, the earliest
    first; so a likelier one within the packet, such as a payload that continues the preamble,
    displaces nothing.
    """

    _LEAST_PREAMBLE = 0.7  # normalised correlation of seven soft bits
    _BITS = np.arange(PACKET_BITS + 1)

    def __init__(self, bank: WordBank, bit_s: float, *, hard: bool) -> None:
        """Look for the packets of `bank`; `hard` decides bit by bit and corrects three."""
        self._bank = bank
        self._bit_s = bit_s
        self._hard = hard
        self.hypotheses_a_sample = 0.03 if hard else 0.08
        preamble = PREAMBLE - PREAMBLE.mean()
        self._preamble = preamble / np.sqrt(preamble @ preamble)

    def ended(
        self, view: View, end_s: Floats, credible: NDArray[np.bool_], demand: Demand
    ) -> Candidates | None:
        """Return packets that ended with one of the frames, as `Search.ended`."""
        # Of the eighths of bits, those at which an exposure ends.
        sample_s = self._bit_s / 2
        frames = view.end_s[np.searchsorted(view.end_s, end_s[0] - sample_s / 8) :]
        frames = frames[frames <= end_s[-1] + sample_s / 8]
        if not len(frames):
            return None
        start_s = frames - PACKET_BITS * self._bit_s
        edges_s = start_s[:, None] + self._bit_s * self._BITS
        soft = view.soft_bits(edges_s)
        level = soft.steady(1)
        head = level.value[:, : len(PREAMBLE)]
        head = head - head.mean(axis=1, keepdims=True)
        norm = np.sqrt(np.einsum('hbz,hbz->hz', head, head)) + 1e-9
        good = np.matmul(self._preamble, head) > self._LEAST_PREAMBLE * norm
        good &= level.told > LEAST_PRESENT * PACKET_SAMPLES
        good &= credible[np.clip(np.searchsorted(end_s, frames), 0, len(end_s) - 1)]
        if not good.any():
            return None
        chosen = np.nonzero(good)
        rows, phase = level.value[chosen[0], :, chosen[1]], soft.phase[chosen[0]]
        energy = (level.energy * level.told / PACKET_SAMPLES)[chosen]
        if self._hard:
            # The preamble tells the level between bright and dark: it has both.
            levels = rows[:, : len(PREAMBLE)]
            dark = levels[:, PREAMBLE == 1].mean(axis=1)
            bright = levels[:, PREAMBLE == 0].mean(axis=1)
            bits = rows[:, -WORD_BITS:] > ((dark + bright) / 2)[:, None]
            ids = decode(bits).ids
            readable = np.isin(ids, self._bank.ids)
            chosen = (chosen[0][readable], chosen[1][readable])
            ids = ids[readable]
            rows, energy, phase = rows[readable], energy[readable], phase[readable]
            column = np.searchsorted(self._bank.ids, ids)
            explained = self._bank.explained(rows, column, phase, PACKET_SAMPLES)
            correlation = explained / np.sqrt(energy)
        else:
            best = self._bank.best(rows, energy, phase, PACKET_SAMPLES)
            ids, correlation = best.ids, best.correlation
        kept = correlation > COARSE * 0.9 * demand.correlation
        h, z = chosen[0][kept], chosen[1][kept]
        count = len(h)
        return joined(
            [
                Candidates(
                    zone=z,
                    ids=ids[kept],
                    start_s=start_s[h],
                    bit_s=np.full(count, self._bit_s),
                    begin_s=start_s[h],
                    end_s=frames[h],
                    packets=np.ones(count, dtype=np.int64),
                    repeats=np.zeros(count, dtype=bool),
                    still=np.zeros(count, dtype=bool),
                    correlation=correlation[kept],
                    rival=np.zeros(count),
                )
            ],
            demand.least,
        )
