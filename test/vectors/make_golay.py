# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Make golay.txt: the words of all marker IDs, computed by komm and nothing of this package.

All extended Golay codes are one code up to the order of the bits. This finds an order that
turns komm's code into one with the parity bits of a bordered double circulant, and writes
komm's words in that order.

Run: python test/vectors/make_golay.py > test/vectors/golay.txt
"""

import komm  # type: ignore[import-untyped]
import numpy as np
from numpy.typing import NDArray

Bits = NDArray[np.int64]

CIRCULANT = (0, 2, 6, 7, 8, 10)
IDS = np.arange(4096)


def bordered_double_circulant() -> Bits:
    """Return the generator [I | B], shape (12, 24): B a circulant, then a border of ones."""
    generator = np.zeros((12, 24), dtype=np.int64)
    for row in range(11):
        generator[row, row] = 1
        for place in CIRCULANT:
            generator[row, 12 + (place - row) % 11] = 1
        generator[row, 23] = 1
    generator[11, 11:23] = 1
    return generator


def bits_of(ids: NDArray[np.int64]) -> Bits:
    """Return IDs of shape (...) as bits (..., 12), most significant first."""
    return ids[..., None] >> np.arange(11, -1, -1) & 1


def octads(generator: Bits) -> Bits:
    """Return the words of weight eight, shape (759, 24)."""
    words = bits_of(IDS) @ generator % 2
    selected: Bits = words[words.sum(axis=1) == 8]
    return selected


def order_of_bits(ours: Bits, theirs: Bits) -> list[int]:
    """Return for each bit of our word which bit of theirs it is.

    A depth-first search: it goes on while the two sets of octads, restricted to the bits
    that are placed, are the same.
    """
    our_octads, their_octads = octads(ours), octads(theirs)

    def restricted(words: Bits, places: list[int]) -> list[int]:
        return sorted((words[:, places] @ (1 << np.arange(len(places)))).tolist())

    def extend(order: list[int]) -> list[int] | None:
        if len(order) == 24:
            return order
        target = restricted(our_octads, list(range(len(order) + 1)))
        for place in sorted(set(range(24)) - set(order)):
            candidate = [*order, place]
            if restricted(their_octads, candidate) == target:
                found = extend(candidate)
                if found is not None:
                    return found
        return None

    order = extend([])
    if order is None:
        raise SystemExit('the two codes are not equivalent')
    return order


def main() -> None:
    """Print the vectors."""
    code = komm.GolayCode(extended=True)
    ours = bordered_double_circulant()
    order = order_of_bits(ours, np.asarray(code.generator_matrix))
    words = np.asarray(code.encode(bits_of(IDS)))[:, order]
    ids = words[:, :12] @ (1 << np.arange(11, -1, -1))
    assert np.array_equal(words, bits_of(ids) @ ours % 2)
    assert np.array_equal(np.sort(ids), IDS)
    print('# Extended Golay words, most significant bit first: ID, word in hexadecimal.')
    print(f'# komm {komm.__version__}, its bits taken in the order {" ".join(map(str, order))}')
    for marker_id, word in sorted(zip(ids, words @ (1 << np.arange(23, -1, -1)), strict=True)):
        print(f'{marker_id} {word:06x}')


if __name__ == '__main__':
    main()
