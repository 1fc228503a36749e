# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 5: whether another ID explains the same samples nearly as well."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.code import PACKET_BITS, PREAMBLE
from retrolidar_ros.detector.evidence import nats
from retrolidar_ros.detector.soft_bits import SILENT_BITS
from retrolidar_ros.detector.words import WordBank, phase_step, template_energy
from retrolidar_ros.frame import Floats

# A lone packet may have begun before the window, or end after it, by up to so many bits.
_MOST_CUT = 16
# A part of a lone packet that explains this share of what a repeating one does is as likely.
_AS_GOOD = 0.99
SHIFTS = (np.arange(PACKET_BITS)[:, None] + np.arange(PACKET_BITS)) % PACKET_BITS
"""Bits of a window that begins with any bit of a packet, shape (31, 31)."""


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
        own, nearest = 0.0, 0.0
        if len(window.soft) == PACKET_BITS:
            own, nearest = self._repeating(window, column)
        if window.packets == 1:
            lone, other = self._lone_ones(window, column)
            if not window.repeats:
                own = lone
            elif lone > _AS_GOOD * own:
                return None
            nearest = max(nearest, other)
        root = np.sqrt(window.energy)
        ours, theirs = nats(np.array([own, nearest]) / root, np.full(2, window.samples))
        return float(ours - theirs)

    def _repeating(self, window: Window, column: int) -> tuple[float, float]:
        """Return what the packet explains if it repeats, and another one at most, at any bit."""
        count = len(window.soft)
        rows = window.soft[SHIFTS]
        first = window.first % PACKET_BITS
        own = self._bank.correlations(rows[first : first + 1], window.phase, 2 * count)[0]
        explained = float(own[column])
        own[column] = 0.0
        nearest = float(own.max())
        # Rows that cannot come near are not looked at.
        worth = self._bank.bound(rows[:, :, None], 2 * count)[:, 0] > nearest
        worth[first] = False
        if worth.any():
            others = self._bank.correlations(rows[worth], window.phase, 2 * count)
            others[:, column] = 0.0
            nearest = max(nearest, float(others.max()))
        return explained, nearest

    def _lone_ones(self, window: Window, column: int) -> tuple[float, float]:
        """Return what the packet explains if it is alone, and another one at most.

        A packet that was found alone begins where it was found; one that was taken for a
        repeating one may be alone anywhere else.
        """
        lone = self._lone[len(window.soft)]
        padded = np.zeros(len(window.soft) + 2 * PACKET_BITS)
        padded[PACKET_BITS:-PACKET_BITS] = window.soft
        rows = padded[lone.first[:, None] + PACKET_BITS + np.arange(PACKET_BITS)]
        head = rows[:, : len(PREAMBLE)] @ PREAMBLE
        word = rows[:, len(PREAMBLE) :].astype(np.float32)
        explained = word @ self._words
        explained += head[:, None].astype(np.float32)
        explained *= lone.scale[phase_step(window.phase)]
        ours = explained[:, column]
        own = float(ours.max() if window.repeats else ours[lone.first == window.first].max())
        explained[:, column] = 0.0
        return own, float(explained.max())


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
        both = sent & np.roll(sent, -1, axis=1)
        both[:, -1] = False
        bits = bank.bits.astype(float)
        dark = sent.astype(float) @ bits.T
        pairs = both.astype(float) @ (bits * np.roll(bits, -1, axis=1)).T
        energy = template_energy(dark, pairs, 2 * window_bits)
        # A packet that shows nothing dark in the window explains nothing.
        inverse = np.divide(1.0, energy, out=np.zeros_like(energy), where=energy > 1.0)
        self.scale = np.sqrt(inverse).astype(np.float32)
