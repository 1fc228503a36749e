# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 3b: repeating packets, read from any bit, and several of them at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS
from retrolidar_ros.detector.candidates import Candidates, joined
from retrolidar_ros.detector.search import LEAST_PRESENT, PACKET_SAMPLES, Demand
from retrolidar_ros.detector.starts import EIGHTHS
from retrolidar_ros.detector.view import View
from retrolidar_ros.detector.words import SHIFTS, WordBank, template_energy
from retrolidar_ros.frame import Floats

# Share of the best correlation below which another ID is no rival.
_RIVAL = 0.75


class FoldSearch:
    """Any stretch of a repeating packet, or several such packets laid on top of each other."""

    _KEPT = 3  # starts and clocks whose fold stands out most, of every zone
    _MOST_SKEW = 0.01

    def __init__(self, bank: WordBank, bit_s: float) -> None:
        """Look for the packets of `bank` with bits of about `bit_s`."""
        self._bank = bank
        self._bit_s = bit_s

    def folded(self, view: View, end_s: float, packets: int, demand: Demand) -> Candidates | None:
        """Return packets that repeated in the last `packets` times their length."""
        # A quarter of a sample at either end of the window is the most that a clock may miss.
        steps = int(np.ceil(self._MOST_SKEW / (0.016 / packets) - 0.3))
        skews = np.linspace(-self._MOST_SKEW, self._MOST_SKEW, 2 * steps + 1)
        if packets == 1:
            skews = skews * 0.67
        bits = PACKET_BITS * packets
        middle_s = end_s - bits * self._bit_s * (1 + self._MOST_SKEW) / 2
        middles_s = np.repeat(middle_s - np.arange(EIGHTHS) * self._bit_s / EIGHTHS, len(skews))
        bit_s = np.tile(self._bit_s * (1 + skews), EIGHTHS)
        first_s = middles_s - bits / 2 * bit_s
        edges_s = first_s[:, None] + bit_s[:, None] * np.arange(bits + 1)
        soft = view.soft_bits(edges_s)
        # A line takes off some of a single packet, which one depends on where it begins.
        level = soft.drifting() if packets > 1 else soft.steady(1)
        hypotheses, zones = level.energy.shape
        value = level.value.reshape(hypotheses, packets, PACKET_BITS, zones).sum(axis=1)
        present = level.told / (2 * bits)
        energy = level.energy * present * packets
        # A template that begins within exposures is weaker, and so are the bits cut there.
        strength = template_energy(PACKET_BITS / 2, PACKET_BITS / 4, PACKET_SAMPLES, soft.phase)
        standing = np.einsum('hbz,hbz->hz', value, value) / np.maximum(energy, 1e-9)
        standing /= strength[:, None]
        kept = min(self._KEPT, hypotheses)
        top = np.argpartition(-standing, kept - 1, axis=0)[:kept]
        column = np.broadcast_to(np.arange(zones), top.shape)
        h: NDArray[np.intp] = top.ravel()
        z: NDArray[np.intp] = column.ravel()
        complete = np.broadcast_to(present, standing.shape)[h, z] > LEAST_PRESENT
        h, z = h[complete], z[complete]
        if not len(h):
            return None
        rows = value[h, :, z][:, SHIFTS]  # (chosen, shifts, bits)
        bound = self._bank.bound(np.moveaxis(rows, 0, 2), PACKET_SAMPLES).T
        least = demand.least_correlation(level.energy, level.told)[h, z]
        root = np.sqrt(energy[h, z])
        chosen, shift = np.nonzero(bound > (least * root)[:, None])
        if not len(chosen):
            return None
        best = self._bank.best(
            rows[chosen, shift], energy[h, z][chosen], soft.phase[h][chosen], PACKET_SAMPLES
        )
        h, z = h[chosen], z[chosen]
        # The frame that began before the window, or with it.
        start_s = first_s[h] + bit_s[h] * np.where(shift > 0, shift - PACKET_BITS, 0)
        count = len(h)
        candidates = joined(
            [
                Candidates(
                    zone=z,
                    ids=best.ids,
                    start_s=start_s,
                    bit_s=bit_s[h],
                    begin_s=first_s[h],
                    end_s=edges_s[h, -1],
                    packets=np.full(count, packets),
                    repeats=np.ones(count, dtype=bool),
                    still=np.zeros(count, dtype=bool),
                    correlation=best.correlation,
                    rival=np.zeros(count),
                )
            ],
            demand.least,
        )
        if candidates is None:
            return None
        rival = [
            self._rival(value[:, :, zone], energy[:, zone], soft.phase, identity, correlation)
            for zone, identity, correlation in zip(
                candidates.zone, candidates.ids, candidates.correlation, strict=True
            )
        ]
        return candidates._replace(rival=np.array(rival))

    def _rival(
        self, value: Floats, energy: Floats, phase: Floats, identity: int, correlation: float
    ) -> float:
        """Return the correlation of the best other ID in one zone, of any start and clock.

        A wrong word may win where start and clock are wrong, too: that is no fair comparison.
        """
        rows = value[:, SHIFTS].reshape(-1, PACKET_BITS)
        root = np.sqrt(energy).repeat(PACKET_BITS)
        bound = self._bank.bound(rows[:, :, None], PACKET_SAMPLES)[:, 0]
        worth = np.flatnonzero(bound > _RIVAL * correlation * root)
        best = self._bank.best(
            rows[worth],
            energy.repeat(PACKET_BITS)[worth],
            phase.repeat(PACKET_BITS)[worth],
            PACKET_SAMPLES,
        )
        return float(best.correlation[best.ids != identity].max(initial=0.0))
