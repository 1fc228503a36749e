# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a marker sends: a 7-bit preamble and an extended Golay (24, 12) word.

A bit 1 is a dark bit: the liquid crystal is driven and blocks the light (paper §2.2).
Words are rows of bits, most significant bit first, in any leading batch shape.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

ID_BITS = 12
WORD_BITS = 24
IDS = 1 << ID_BITS
MAX_CORRECTED_BITS = 3
PREAMBLE: NDArray[np.uint8] = np.array([1, 0, 1, 0, 1, 0, 1], dtype=np.uint8)
PACKET_BITS = len(PREAMBLE) + WORD_BITS
BIT_PERIOD_S = 0.042  # two 21 ms frames (paper §3.4 and §5)
BIT_PERIOD_LIMITS_S = (0.002, 10.0)
# Their words are all bright and all dark: nothing is modulated after the preamble.
RESERVED_IDS = (0, IDS - 1)


def _parity_matrix() -> NDArray[np.uint8]:
    """Return the bordered circulant B of the generator [I | B], shape (12, 12).

    Its circulant is symmetric, entry (i, j) depending on i + j mod 11. Any rotation of the rows
    makes a Golay code, but with this one no packet comes within one bit of a cyclic shift of
    another, and 3593 of the 4096 keep four bits away from all of them.
    """
    row_plus_column = np.add.outer(np.arange(11), np.arange(11)) % 11
    matrix = np.ones((ID_BITS, ID_BITS), dtype=np.uint8)
    matrix[:11, :11] = np.isin(row_plus_column, (0, 2, 6, 7, 8, 10))
    matrix[11, 11] = 0
    return matrix


PARITY = _parity_matrix()
GENERATOR: NDArray[np.uint8] = np.hstack([np.eye(ID_BITS, dtype=np.uint8), PARITY])
PARITY_CHECK: NDArray[np.uint8] = np.hstack([PARITY.T, np.eye(ID_BITS, dtype=np.uint8)])


def _to_bits(numbers: NDArray[np.int64], width: int) -> NDArray[np.uint8]:
    """Expand integers of any shape (...) to bits (..., width), most significant bit first."""
    shifts = np.arange(width - 1, -1, -1)
    bits: NDArray[np.uint8] = ((numbers[..., None] >> shifts) & 1).astype(np.uint8)
    return bits


def _to_numbers(bits: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Pack bits (..., width), most significant bit first, to integers (...)."""
    weights = 1 << np.arange(bits.shape[-1] - 1, -1, -1, dtype=np.int64)
    numbers: NDArray[np.int64] = bits.astype(np.int64) @ weights
    return numbers


WORDS: NDArray[np.uint8] = _to_bits(np.arange(IDS), ID_BITS) @ GENERATOR % 2
"""The words of all IDs, shape (4096, 24)."""

_PARITY_OF_ID = _to_numbers(WORDS[:, ID_BITS:])


def _coset_leaders() -> tuple[NDArray[np.int64], NDArray[np.int8]]:
    """Tabulate for each of 4096 syndromes the lightest error and its weight, -1 above three.

    A coset whose leader has weight four has six leaders of that weight, so four errors are
    detected but cannot be corrected.
    """
    errors = np.zeros(IDS, dtype=np.int64)
    weights = np.full(IDS, -1, dtype=np.int8)
    single = 1 << np.arange(WORD_BITS, dtype=np.int64)
    patterns = np.zeros(1, dtype=np.int64)
    for weight in range(MAX_CORRECTED_BITS + 1):
        syndromes = _syndromes(patterns)
        errors[syndromes] = patterns
        weights[syndromes] = weight
        wider = np.bitwise_or.outer(patterns, single).ravel()
        patterns = np.unique(wider[~np.isin(wider, patterns)])
    return errors, weights


def _syndromes(words: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the 12-bit syndromes of packed words: the parity sent against that expected."""
    expected: NDArray[np.int64] = _PARITY_OF_ID[words >> ID_BITS]
    return expected ^ (words & (IDS - 1))


_ERROR_OF_SYNDROME, _WEIGHT_OF_SYNDROME = _coset_leaders()


class Decoded(NamedTuple):
    """The outcome of decoding, each of the words' batch shape."""

    ids: NDArray[np.int64]
    """The decoded ID, -1 where the word was refused."""
    corrected_bits: NDArray[np.int8]
    """How many bits were wrong, 0 to 3; -1 where four or more were, and the word is refused."""


def check_ids(ids: ArrayLike) -> NDArray[np.int64]:
    """Return `ids` as integers, or raise ValueError naming one outside 0..4095."""
    numbers = np.asarray(ids)
    if not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(f'a marker ID must be an integer, not {numbers.dtype}')
    outside = numbers[(numbers < 0) | (numbers >= IDS)]
    if outside.size:
        raise ValueError(f'marker ID {outside.flat[0]} is outside 0..{IDS - 1}')
    return numbers.astype(np.int64)


def encode(ids: ArrayLike) -> NDArray[np.uint8]:
    """Return the Golay words of marker IDs.

    Parameters
    ----------
    ids : array of int, shape (...)
        0..4095.

    Returns
    -------
    array of uint8, shape (..., 24)
        Bits, most significant first; the first twelve are the ID itself.

    Raises
    ------
    ValueError
        If an ID is no integer or outside 0..4095.
    """
    return WORDS[check_ids(ids)]


def packet(ids: ArrayLike) -> NDArray[np.uint8]:
    """Return preamble and word of marker IDs of shape (...), as bits of shape (..., 31).

    Raises
    ------
    ValueError
        If an ID is no integer or outside 0..4095.
    """
    words = encode(ids)
    preamble = np.broadcast_to(PREAMBLE, (*words.shape[:-1], len(PREAMBLE)))
    return np.concatenate([preamble, words], axis=-1)


def decode(words: ArrayLike) -> Decoded:
    """Correct up to three wrong bits a word; refuse a word with four.

    Any word within three bits of a code word decodes to it, and these are 56.8 % of all
    24-bit patterns: a decoded ID alone is no evidence that a marker was there.

    Parameters
    ----------
    words : array of 0 and 1, shape (..., 24)
        Most significant bit first.

    Returns
    -------
    Decoded
        IDs and corrected bits, each of shape (...).

    Raises
    ------
    ValueError
        If the last axis is not 24 long or an entry is neither 0 nor 1.
    """
    bits = np.asarray(words)
    if bits.ndim == 0 or bits.shape[-1] != WORD_BITS:
        raise ValueError(f'a word has {WORD_BITS} bits on its last axis, not shape {bits.shape}')
    if not np.isin(bits, (0, 1)).all():
        raise ValueError('a word holds only 0 and 1')
    packed = _to_numbers(bits.astype(np.uint8))
    syndromes = _syndromes(packed)
    corrected_bits = _WEIGHT_OF_SYNDROME[syndromes]
    ids = (packed ^ _ERROR_OF_SYNDROME[syndromes]) >> ID_BITS
    return Decoded(np.where(corrected_bits >= 0, ids, -1), corrected_bits)
