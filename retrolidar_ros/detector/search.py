# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where packets may be: the methods' different ways to a start, a clock and a word."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE, WORD_BITS, decode
from retrolidar_ros.detector.evidence import nats
from retrolidar_ros.detector.fit import Candidates
from retrolidar_ros.detector.soft_bits import SILENT_BITS, SoftBits, soft_bits
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.words import WordBank
from retrolidar_ros.frame import Floats

PACKET_SAMPLES = 2 * PACKET_BITS
_STILL_SAMPLES = 2 * (PACKET_BITS + SILENT_BITS)
# Whoever has lost more of a packet than this has nothing to judge by.
_LEAST_PRESENT = 0.45
# What the coarse templates of a search may miss of what an exact one explains.
COARSE = 0.94


class Demand(NamedTuple):
    """What a search asks of a candidate."""

    correlation: float
    """Least correlation of an exact fit."""
    noise: Floats
    """Variance that the sensor's noise has in each zone of the view, shape (zones,)."""

    def least_correlation(self, energy: Floats, samples: Floats) -> Floats:
        """Return the least coarse correlation for energies (hypotheses, zones).

        Apart from the least for evidence, what a packet leaves over must be noise, so the
        clearer a zone modulates the better a packet has to fit.
        """
        if self.correlation <= 0:
            return np.zeros_like(energy)
        noisy = 2.5 * self.noise * np.maximum(samples, 1.0)[:, None] / energy
        return np.sqrt(np.maximum((COARSE * self.correlation) ** 2, 0.93 - noisy))


class Search(Protocol):
    """Finds packets in a view."""

    def ended(self, view: View, end_s: Floats, demand: Demand) -> Candidates | None:
        """Return packets that ended at one of some times (ends,), on a grid of eighths of bits."""


def _rows(
    soft: SoftBits, chosen: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> tuple[Floats, Floats, Floats]:
    """Return soft bits, energies and phases of chosen (hypotheses, zones), a row each."""
    hypothesis, zone = chosen
    return soft.value[hypothesis, :, zone], soft.energy[hypothesis, zone], soft.phase[hypothesis]


class JointSearch:
    """Start, phase, clock and word together: the packet that explains the samples best."""

    _SKEWS = np.array([0.0, -0.0067, 0.0067])
    _BITS = np.arange(PACKET_BITS + 1)

    def __init__(self, bank: WordBank, bit_s: float) -> None:
        """Look for the packets of `bank` with bits of about `bit_s`."""
        self._bank = bank
        self._bit_s = bit_s

    def ended(self, view: View, end_s: Floats, demand: Demand) -> Candidates | None:
        """Return packets that ended at one of some times, one a zone and time at most."""
        bit_s = np.tile(self._bit_s * (1 + self._SKEWS), len(end_s))
        ends_s = np.repeat(end_s, len(self._SKEWS))
        start_s = ends_s - PACKET_BITS * bit_s
        edges_s = start_s[:, None] + bit_s[:, None] * self._BITS
        found = []
        for silent_s, samples in (
            (0.0, PACKET_SAMPLES),
            (SILENT_BITS * self._bit_s, _STILL_SAMPLES),
        ):
            soft = soft_bits(
                view.integral, view.squares, edges_s, silent_s=silent_s, line=not silent_s
            )
            begin_s = start_s - silent_s
            present = view.present(begin_s, ends_s)
            fill = np.maximum(present / samples, 1e-9)
            energy = soft.energy * fill
            bound = self._bank.bound(soft.value, samples)
            least = demand.least_correlation(soft.energy, soft.samples)
            chosen = np.nonzero((bound > least * np.sqrt(energy)) & (fill > _LEAST_PRESENT))
            if not len(chosen[0]):
                continue
            rows, _, phase = _rows(soft, chosen)
            best = self._bank.best(rows, energy[chosen], phase, samples)
            kept = best.correlation > least[chosen]
            h, z = chosen[0][kept], chosen[1][kept]
            count = len(h)
            found.append(
                Candidates(
                    zone=z,
                    ids=best.ids[kept],
                    start_s=start_s[h],
                    bit_s=bit_s[h],
                    begin_s=begin_s[h],
                    end_s=ends_s[h],
                    packets=np.ones(count, dtype=np.int64),
                    repeats=np.zeros(count, dtype=bool),
                    still=np.full(count, silent_s > 0),
                    correlation=best.correlation[kept],
                )
            )
        return joined(found)


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
        preamble = PREAMBLE - PREAMBLE.mean()
        self._preamble = preamble / np.sqrt(preamble @ preamble)

    def ended(self, view: View, end_s: Floats, demand: Demand) -> Candidates | None:
        """Return packets that ended with one of the frames."""
        # Of the eighths of bits, those at which an exposure ends.
        sample_s = self._bit_s / 2
        frames = view.end_s[np.searchsorted(view.end_s, end_s[0] - sample_s / 8) :]
        frames = frames[frames <= end_s[-1] + sample_s / 8]
        if not len(frames):
            return None
        start_s = frames - PACKET_BITS * self._bit_s
        edges_s = start_s[:, None] + self._bit_s * self._BITS
        soft = soft_bits(view.integral, view.squares, edges_s, line=False)
        head = soft.value[:, : len(PREAMBLE)]
        head = head - head.mean(axis=1, keepdims=True)
        norm = np.sqrt(np.einsum('hbz,hbz->hz', head, head)) + 1e-9
        likeness = np.einsum('b,hbz->hz', self._preamble, head) / norm
        fill = view.present(start_s, frames) / PACKET_SAMPLES
        chosen = np.nonzero((likeness > self._LEAST_PREAMBLE) & (fill > _LEAST_PRESENT))
        if not len(chosen[0]):
            return None
        rows, energy, phase = _rows(soft, chosen)
        energy = energy * np.broadcast_to(fill, soft.energy.shape)[chosen]
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
                )
            ]
        )


class FoldSearch:
    """Any stretch of a repeating packet, or several such packets laid on top of each other."""

    _KEPT = 2  # starts and clocks whose fold stands out most, of every zone
    _MOST_SKEW = 0.01

    def __init__(self, bank: WordBank, bit_s: float) -> None:
        """Look for the packets of `bank` with bits of about `bit_s`."""
        self._bank = bank
        self._bit_s = bit_s
        self._shifts = (np.arange(PACKET_BITS)[:, None] + np.arange(PACKET_BITS)) % PACKET_BITS

    def folded(self, view: View, end_s: float, packets: int, demand: Demand) -> Candidates | None:
        """Return packets that repeated in the last `packets` times their length."""
        # A quarter of a sample at either end of the window is the most that a clock may miss.
        steps = int(np.ceil(self._MOST_SKEW / (0.016 / packets) - 0.3))
        skews = np.linspace(-self._MOST_SKEW, self._MOST_SKEW, 2 * steps + 1)
        if packets == 1:
            skews = skews * 0.67
        bits = PACKET_BITS * packets
        middle_s = end_s - bits * self._bit_s * (1 + self._MOST_SKEW) / 2
        middles_s = np.repeat(middle_s - np.arange(8) * self._bit_s / 8, len(skews))
        bit_s = np.tile(self._bit_s * (1 + skews), 8)
        first_s = middles_s - bits / 2 * bit_s
        edges_s = first_s[:, None] + bit_s[:, None] * np.arange(bits + 1)
        soft = soft_bits(view.integral, view.squares, edges_s)
        hypotheses, zones = soft.energy.shape
        value = soft.value.reshape(hypotheses, packets, PACKET_BITS, zones).sum(axis=1)
        present = view.present(first_s, edges_s[:, -1]) / (2 * bits)
        energy = soft.energy * np.maximum(present, 1e-9) * packets
        standing = np.einsum('hbz,hbz->hz', value, value) / energy
        kept = min(self._KEPT, hypotheses)
        top = np.argpartition(-standing, kept - 1, axis=0)[:kept]
        column = np.broadcast_to(np.arange(zones), top.shape)
        h, z = top.ravel(), column.ravel()
        complete = np.broadcast_to(present, standing.shape)[h, z] > _LEAST_PRESENT
        h, z = h[complete], z[complete]
        if not len(h):
            return None
        rows = value[h, :, z][:, self._shifts]  # (chosen, shifts, bits)
        bound = self._bank.bound(np.moveaxis(rows, 0, 2), PACKET_SAMPLES).T
        least = demand.least_correlation(soft.energy, soft.samples)[h, z]
        root = np.sqrt(energy[h, z])
        chosen, shift = np.nonzero(bound > (least * root)[:, None])
        if not len(chosen):
            return None
        best = self._bank.best(
            rows[chosen, shift], energy[h, z][chosen], soft.phase[h][chosen], PACKET_SAMPLES
        )
        good = best.correlation > least[chosen]
        h, z, shift = h[chosen[good]], z[chosen[good]], shift[good]
        # The frame that began before the window, or with it.
        start_s = first_s[h] + bit_s[h] * np.where(shift > 0, shift - PACKET_BITS, 0)
        count = len(h)
        return joined(
            [
                Candidates(
                    zone=z,
                    ids=best.ids[good],
                    start_s=start_s,
                    bit_s=bit_s[h],
                    begin_s=first_s[h],
                    end_s=edges_s[h, -1],
                    packets=np.full(count, packets),
                    repeats=np.ones(count, dtype=bool),
                    still=np.zeros(count, dtype=bool),
                    correlation=best.correlation[good],
                )
            ]
        )


def joined(found: list[Candidates]) -> Candidates | None:
    """Return the best candidate of each zone and packet among all that were found.

    What overlaps by more than half a packet in a zone is the same packet found more than once.
    """
    found = [candidates for candidates in found if len(candidates.zone)]
    if not found:
        return None
    together = Candidates(*(np.concatenate(fields) for fields in zip(*found, strict=True)))
    samples = 2 * (together.end_s - together.begin_s) / together.bit_s
    order = np.argsort(-nats(together.correlation, samples), kind='stable')
    kept: list[int] = []
    for index in order.tolist():
        half_s = together.bit_s[index] * PACKET_BITS / 2
        if all(
            together.zone[other] != together.zone[index]
            or abs(together.end_s[other] - together.end_s[index]) > half_s
            for other in kept
        ):
            kept.append(index)
    return together.at(np.array(kept, dtype=np.intp))
