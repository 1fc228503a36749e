# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 5: whether another ID explains the same samples nearly as well."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE
from retrolidar_ros.detector.evidence import nats
from retrolidar_ros.detector.search import PACKET_SAMPLES
from retrolidar_ros.detector.soft_bits import SILENT_BITS
from retrolidar_ros.detector.words import PHASES, SHIFTS, WordBank, phase_step, template_energy
from retrolidar_ros.frame import Floats

# A lone packet may have begun before the window, or end after it, by up to so many bits.
_MOST_CUT = 16
# A window is whole if each bit has this share of its samples.
_WHOLE = 0.9
_WHOLE_PACKET: Floats = np.ones((1, PACKET_BITS))
# What is left of a template where bits are erased may correlate so much more than the bound says.
_ERASED_BOUND = 0.75
ENOUGH_NATS = 15.0
"""Nobody asks for a greater lead, so a greater one need not be known exactly."""
# A part of a lone packet that explains this share of what a repeating one does is as likely.
_AS_GOOD = 0.99


class Window(NamedTuple):
    """Soft bits in which a packet was found, in the order of time."""

    soft: Floats
    """Less their mean; 31 of a packet (or several on top of each other), or silence before, too."""
    energy: float
    """Squared deviation of the samples, scaled as for `WordBank.best`."""
    phase: float
    """Of the bits in an exposure."""
    samples: float
    """How many samples tell."""
    first: int
    """Bit of the window with which the packet begins."""
    repeats: bool
    """Whether the window is any stretch of a repeating packet."""
    packets: int
    """How many it holds; only a single one may be a lone one."""
    presence: Floats
    """Share of each bit that was not erased, of the shape of `soft`."""


class Rivals:
    """What else a window of soft bits could be.

    A repeating packet read from another bit, or a lone one that begins at any bit, even if the
    window holds only its beginning or its end. The latter is how a marker that wakes looks some
    bits before its packet is complete, and a code of distance eight is no help against that.
    """

    def __init__(self, bank: WordBank) -> None:
        """Consider the packets of `bank`."""
        self._bank = bank
        self._words = bank.bits[:, len(PREAMBLE) :].T.astype(np.float32)
        self._lone = {
            bits: _LonePackets(bank, bits) for bits in (PACKET_BITS, PACKET_BITS + SILENT_BITS)
        }

    def margin(self, window: Window, identity: int) -> float | None:
        """Return by how much a packet is likelier than its nearest rival [nats].

        None if it was taken for a repeating one, but a lone packet of the same ID, of which the
        window holds a part, is as likely: it has not ended yet, or has before.
        """
        column = int(np.searchsorted(self._bank.ids, identity))
        repeating = len(window.soft) == PACKET_BITS
        lone = window.packets == 1
        own = self._own_repeating(window, column) if repeating else 0.0
        if lone:
            own_lone = self._own_lone(window, column)
            if not window.repeats:
                own = own_lone
            elif own_lone > _AS_GOOD * own:
                return None
        root = np.sqrt(window.energy)
        samples = np.asarray(window.samples)
        ours = float(nats(np.asarray(own / root), samples))
        # What leads by more than anybody asks need not be known exactly.
        enough = max(ours - ENOUGH_NATS, 0.0)
        least = root * np.sqrt(-np.expm1(-2 * enough / window.samples))
        if window.presence.min() <= _WHOLE:
            least *= _ERASED_BOUND
        nearest = least
        if repeating:
            nearest = max(nearest, self._nearest_repeating(window, column, least))
        if lone:
            nearest = max(nearest, self._nearest_lone(window, column, least))
        return ours - float(nats(np.asarray(nearest / root), samples))

    def _own_repeating(self, window: Window, column: int) -> float:
        """Return what the packet explains if it repeats."""
        own = np.roll(window.soft, -window.first)[None]
        explained = self._bank.correlations(own, window.phase, PACKET_SAMPLES)[0, column]
        there = np.roll(window.presence, -window.first)[None]
        return float(
            explained
            * self._unerased(there, _WHOLE_PACKET, window, slice(column, column + 1))[0, 0]
        )

    def _unerased(self, there: Floats, sent: Floats, window: Window, words: slice) -> Floats:
        """Return what correlations (rows, words) are to be scaled by where bits were erased.

        An erased bit adds nothing to what a packet explains, so it must not count in the energy
        of its template either, or packets that are bright there would seem the better ones. The
        samples' own energy was scaled for the mean of all packets, which is undone here.

        Parameters
        ----------
        there, sent : array, shape (rows, 31)
            Share of each bit of a packet that tells, and whether the window holds it.
        window : Window
        words : slice
            Of the bank.
        """
        if window.presence.min() > _WHOLE:
            return np.ones((1, 1), dtype=np.float32)
        bits = self._bank.bits[words].T.astype(float)
        total = 2.0 * len(window.presence)
        told = 2.0 * window.presence.sum()
        full, left = 2.0 * sent @ bits, 2.0 * there @ bits
        full = np.maximum(full - full * full / total, 1.0)
        left = np.maximum(left - left * left / told, 1.0)
        factor: Floats = np.sqrt(full / left * (told / total)).astype(np.float32)
        return factor

    def _own_lone(self, window: Window, column: int) -> float:
        """Return what the packet explains if it is alone.

        One that was found alone begins where it was found; one that was taken for a repeating
        one may be alone anywhere.
        """
        lone = self._lone[len(window.soft)]
        explained = lone.rows(window.soft) @ self._bank.bits[column]
        explained = explained * lone.scale[phase_step(window.phase)][:, column]
        there = lone.rows(window.presence)
        explained *= self._unerased(there, lone.sent, window, slice(column, column + 1))[:, 0]
        at = lone.first == window.first
        return float((explained if window.repeats else explained[at]).max())

    def _nearest_repeating(self, window: Window, column: int, least: float) -> float:
        """Return what another packet explains at most if it repeats, read from any bit."""
        rows = window.soft[SHIFTS]
        worth = self._bank.bound(rows[:, :, None], PACKET_SAMPLES)[:, 0] > least
        if not worth.any():
            return 0.0
        explained = self._bank.correlations(rows[worth], window.phase, PACKET_SAMPLES)
        explained *= self._unerased(
            window.presence[SHIFTS][worth], _WHOLE_PACKET, window, slice(None)
        )
        explained[:, column] = 0.0
        return float(explained.max())

    def _nearest_lone(self, window: Window, column: int, least: float) -> float:
        """Return what another packet explains at most if it is alone."""
        lone = self._lone[len(window.soft)]
        rows = lone.rows(window.soft)
        head = rows[:, : len(PREAMBLE)] @ PREAMBLE
        step = int(phase_step(window.phase))
        most = head + np.maximum(rows[:, len(PREAMBLE) :], 0.0).sum(axis=1)
        worth = np.flatnonzero(most * lone.most_scale[step] > least)
        if not len(worth):
            return 0.0
        explained = rows[worth, len(PREAMBLE) :].astype(np.float32) @ self._words
        explained += head[worth, None].astype(np.float32)
        explained *= lone.scale[step][worth]
        explained *= self._unerased(
            lone.rows(window.presence)[worth], lone.sent[worth], window, slice(None)
        )
        explained[:, column] = 0.0
        return float(explained.max())


class _LonePackets:
    """Templates of lone packets in a window of so many bits, wherever they begin."""

    first: NDArray[np.intp]
    """Bits of the window with which they begin, shape (places,)."""
    scale: NDArray[np.float32]
    """One over the root of their energies, shape (phases, places, words)."""

    def __init__(self, bank: WordBank, window_bits: int) -> None:
        self.first = np.arange(-_MOST_CUT, window_bits - PACKET_BITS + _MOST_CUT + 1)
        position = self.first[:, None] + np.arange(PACKET_BITS)
        sent = (position >= 0) & (position < window_bits)
        self.sent: Floats = sent.astype(float)
        both = sent & np.roll(sent, -1, axis=1)
        both[:, -1] = False
        bits = bank.bits.astype(float)
        dark = self.sent @ bits.T
        pairs = both.astype(float) @ (bits * np.roll(bits, -1, axis=1)).T
        energy = template_energy(dark, pairs, 2 * window_bits, PHASES[:, None, None])
        # A packet that shows nothing dark in the window explains nothing.
        inverse = np.divide(1.0, energy, out=np.zeros_like(energy), where=energy > 1.0)
        self.scale = np.sqrt(inverse).astype(np.float32)
        self.most_scale: Floats = self.scale.max(axis=2)

    def rows(self, soft: Floats) -> Floats:
        """Return the soft bits of each place, 0 beyond the window, shape (places, 31)."""
        padded = np.zeros(len(soft) + 2 * PACKET_BITS)
        padded[PACKET_BITS:-PACKET_BITS] = soft
        rows: Floats = padded[self.first[:, None] + PACKET_BITS + np.arange(PACKET_BITS)]
        return rows
