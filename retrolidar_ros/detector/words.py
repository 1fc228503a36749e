# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 3: how well every packet in question explains soft bits."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.code import IDS, PACKET_BITS, PREAMBLE, RESERVED_IDS, WORDS, check_ids, packet
from retrolidar_ros.frame import Floats

_PHASES = 4
PHASES: Floats = np.arange(_PHASES) / _PHASES
"""For which there are templates."""
SHIFTS = (np.arange(PACKET_BITS)[:, None] + np.arange(PACKET_BITS)) % PACKET_BITS
"""Bits of a window that begins with any bit of a packet, shape (31, 31)."""
_ROWS_AT_ONCE = 64  # so that the products of one block stay in a cache of a megabyte
_PREAMBLE = PREAMBLE.astype(float)
_PREAMBLE_BITS = len(PREAMBLE)


class Best(NamedTuple):
    """The packets that explain rows of soft bits best, each field of shape (rows,)."""

    ids: NDArray[np.int64]
    correlation: Floats
    """Normalised, -1 to 1."""


class WordBank:
    """The packets that may come, and their energies."""

    def __init__(self, registered_ids: ArrayLike | None = None) -> None:
        """Take the registered IDs; all usable ones without."""
        ids = np.arange(IDS) if registered_ids is None else np.unique(check_ids(registered_ids))
        self.ids = ids[~np.isin(ids, RESERVED_IDS)]
        if not len(self.ids):
            raise ValueError('registered_ids holds no usable ID (0 and 4095 cannot be read)')
        self.bits = packet(self.ids)
        self._dark = self.bits.sum(axis=1, dtype=float)
        pairs = self.bits * np.roll(self.bits, -1, axis=1)
        self._pairs = pairs.sum(axis=1, dtype=float)
        ramp = np.arange(PACKET_BITS) - (PACKET_BITS - 1) / 2
        self._sloping: Floats = 2 * (self.bits @ ramp) ** 2 / (ramp @ ramp)
        self._templates: dict[tuple[int, bool], NDArray[np.float32]] = {}
        self._block = np.empty((_ROWS_AT_ONCE, len(self.ids)), dtype=np.float32)

    def _normalised(self, samples: int, line: bool) -> NDArray[np.float32]:
        """Return templates over the root of their energies, as is left of them with a mean.

        That is taken over so many samples, and a straight line may be taken off, too. Shape
        (phases, 25, words): the 24 bits of the word, and the preamble as one.
        """
        if (samples, line) not in self._templates:
            energy = self._energy(slice(None), samples, line, PHASES[:, None])
            parts = np.concatenate([np.ones((1, len(self.ids))), WORDS[self.ids].T])
            scaled = parts / np.sqrt(energy)[:, None, :]
            self._templates[samples, line] = np.ascontiguousarray(scaled, dtype=np.float32)
        return self._templates[samples, line]

    def _energy(
        self, column: NDArray[np.intp] | slice, samples: int, line: bool, phase: Floats
    ) -> Floats:
        """Return the energies of packets as is left of them with a mean, and a line."""
        energy = template_energy(self._dark[column], self._pairs[column], samples, phase)
        return energy - self._sloping[column] if line else energy

    def bound(self, value: Floats, samples: int, line: bool = False) -> Floats:
        """Return more than any packet can explain, in the units of `best`.

        Parameters
        ----------
        value : array, shape (hypotheses, 31, zones)
            Soft bits.
        samples : int
            Over which the mean was taken.
        line : bool
            Whether a straight line was taken off, too.

        Returns
        -------
        array, shape (hypotheses, zones)
            The best word picks no other than the positive soft bits.
        """
        word = np.maximum(value[:, _PREAMBLE_BITS:], 0.0).sum(axis=1)
        preamble = np.einsum('b,hbz->hz', _PREAMBLE, value[:, :_PREAMBLE_BITS])
        bound: Floats = (preamble + word) * float(self._normalised(samples, line)[:, 0].max())
        return bound

    def correlations(self, rows: Floats, phase: float, samples: int) -> NDArray[np.float32]:
        """Return what every packet explains of rows of soft bits, not yet over their energy.

        Parameters
        ----------
        rows : array, shape (rows, 31)
        phase : float
            Of the bits in an exposure, 0 to 1.
        samples : int
            Over which the mean was taken.

        Returns
        -------
        array of float32, shape (rows, words)
        """
        product: NDArray[np.float32] = (
            _parts(rows) @ self._normalised(samples, False)[phase_step(phase)]
        )
        return product

    def explained(
        self, rows: Floats, column: NDArray[np.intp], phase: Floats, samples: int
    ) -> Floats:
        """Return what one packet of the bank explains of each row, at its very phase."""
        bits = self.bits[column]
        energy = self._energy(column, samples, False, phase)
        explained: Floats = np.einsum('rb,rb->r', rows, bits) / np.sqrt(energy)
        return explained

    def best(
        self, rows: Floats, energy: Floats, phase: Floats, samples: int, line: bool = False
    ) -> Best:
        """Return the packets of maximum likelihood, gain and offset being free.

        Parameters
        ----------
        rows : array, shape (rows, 31)
            Soft bits.
        energy : array, shape (rows,)
            Of the samples behind them.
        phase : array, shape (rows,)
            Of the bits in an exposure, 0 to 1.
        samples : int
            Over which the mean was taken.
        line : bool
            Whether a straight line was taken off, too.
        """
        index = np.empty(len(rows), dtype=np.intp)
        explained = np.empty(len(rows), dtype=np.float32)
        parts = _parts(rows)
        step = phase_step(phase)
        templates = self._normalised(samples, line)
        for phased in range(_PHASES):
            alike = np.flatnonzero(step == phased)
            for first in range(0, len(alike), _ROWS_AT_ONCE):
                some = alike[first : first + _ROWS_AT_ONCE]
                block = self._block[: len(some)]
                np.matmul(parts[some], templates[phased], out=block)
                top = block.argmax(axis=1)
                index[some] = top
                explained[some] = block[np.arange(len(some)), top]
        # Between two phases there is another energy, which concerns the best word alone.
        coarse = self._energy(index, samples, line, PHASES[step])
        exact = self._energy(index, samples, line, phase)
        return Best(self.ids[index], explained * np.sqrt(coarse / exact / energy))


def template_energy(
    dark: Floats | float, pairs: Floats | float, samples: int, phase: Floats
) -> Floats:
    """Return the energy of templates of packets about their mean, two samples a bit.

    Bits that begin at phase f of an exposure are trapezoids. The sum of their squares is, for n1
    dark bits of which n11 follow another::

        ((1 - f)² + 1 + f²)·n1 + 2·f·(1 - f)·n11 - (2·n1)² / samples

    Parameters
    ----------
    dark, pairs : array, shape (...)
        n1 and n11.
    samples : int
        Over which the mean is taken.
    phase : array, shape (...)
        f.

    Returns
    -------
    array, shape (...)
    """
    f = phase
    squares = ((1 - f) ** 2 + 1 + f * f) * dark + 2 * f * (1 - f) * pairs
    energy: Floats = squares - (2 * dark) ** 2 / samples
    return energy


def _parts(rows: Floats) -> NDArray[np.float32]:
    """Return the preamble's share and the 24 bits of the word, shape (rows, 25)."""
    parts = np.empty((len(rows), 1 + rows.shape[1] - _PREAMBLE_BITS), dtype=np.float32)
    parts[:, 0] = rows[:, :_PREAMBLE_BITS] @ _PREAMBLE
    parts[:, 1:] = rows[:, _PREAMBLE_BITS:]
    return parts


def phase_step(phase: Floats | float) -> NDArray[np.intp]:
    """Return the nearest phase for which there are templates."""
    step: NDArray[np.intp] = np.rint(np.asarray(phase) * _PHASES).astype(np.intp) % _PHASES
    return step
