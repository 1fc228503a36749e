# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The packet of a marker: a 7-bit preamble and an extended Golay (24, 12) word.

The format is that of the core (`core/src/retrolidar_packet_format.h`); another one may be built in.
A bit 1 is a dark bit: the liquid crystal is driven and blocks the light (paper §2.2).
Words are rows of bits, most significant bit first, in any leading batch shape.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.core import lib

ID_BITS: int = lib.RL_ID_BITS
WORD_BITS: int = lib.RL_WORD_BITS
PACKET_BITS: int = lib.RL_PACKET_BITS
IDS = 1 << ID_BITS
MAX_CORRECTED_BITS = (int(lib.RL_WORD_DISTANCE) - 1) // 2
BIT_PERIOD_S = 0.042  # two 21 ms frames (paper §3.4 and §5)
PACKET_S = PACKET_BITS * BIT_PERIOD_S

_NUMBERS = np.array([lib.rl_packet(marker_id) for marker_id in range(IDS)], '>u4')
_PACKETS = np.unpackbits(_NUMBERS[:, None].view(np.uint8), axis=1)[:, -PACKET_BITS:]
WORDS = _PACKETS[:, -WORD_BITS:]  # the codewords of all IDs, shape (4096, 24)
PREAMBLE = _PACKETS[0, :-WORD_BITS]

# Their codewords are all bright and all dark: nothing is modulated after the preamble.
RESERVED_IDS = tuple(marker_id for marker_id in range(IDS) if not lib.rl_id_is_usable(marker_id))

_SIGNS = 1 - 2 * WORDS.T.astype(np.float32)


class Decoded(NamedTuple):
    """The outcome of decoding, each of the words' batch shape."""

    ids: NDArray[np.int64]  # the decoded ID, -1 where the word was rejected
    corrected_bits: NDArray[np.int8]  # how many bits were wrong, 0 to 3; -1 where four or more were


def check_ids(ids: ArrayLike) -> NDArray[np.int64]:
    """Return `ids` as integers, or raise ValueError naming one outside 0..4095."""
    numbers = np.asarray(ids)
    if not np.issubdtype(numbers.dtype, np.integer):
        raise ValueError(f'a marker ID must be an integer, not {numbers.dtype}')
    outside = numbers[(numbers < 0) | (numbers >= IDS)]
    if outside.size:
        raise ValueError(f'marker ID {outside.flat[0]} is outside 0..{IDS - 1}')
    return numbers.astype(np.int64)


def packet(ids: ArrayLike) -> NDArray[np.uint8]:
    """Return preamble and codeword, ID first, of IDs of shape (...), as bits (..., 31)."""
    return _PACKETS[check_ids(ids)]


def decode(words: ArrayLike) -> Decoded:
    """Correct up to three wrong bits a word of shape (..., 24); reject a word with four.

    Of all 24-bit words 56.8 % are within three bits of a codeword, so a decoded ID alone is no
    evidence of a marker. It takes 16 kB of memory a word. ValueError for another shape, or for
    entries that are neither 0 nor 1.
    """
    bits = np.asarray(words)
    if bits.ndim == 0 or bits.shape[-1] != WORD_BITS:
        raise ValueError(f'a word has {WORD_BITS} bits on its last axis, not shape {bits.shape}')
    if not np.isin(bits, (0, 1)).all():
        raise ValueError('a word holds only 0 and 1')
    # Bits as ±1: the product of two words is how many bits agree less how many differ.
    agreement = (1 - 2 * bits.astype(np.float32)) @ _SIGNS
    wrong = ((WORD_BITS - agreement.max(axis=-1)) / 2).astype(np.int8)
    is_read = wrong <= MAX_CORRECTED_BITS
    ids = np.where(is_read, agreement.argmax(axis=-1), -1)
    return Decoded(ids, np.where(is_read, wrong, np.int8(-1)))
