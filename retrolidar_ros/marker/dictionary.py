# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Sets of marker IDs that stay apart at any start bit.

A marker that repeats its packet may be read from any of its 31 bits; only from the first one does
the Golay code keep eight bits between two IDs. So their distance is the minimum Hamming distance
between the packet of one and any cyclic shift of the packet of the other; that of an ID to itself
is over all shifts but 0. Codewords and preamble have even weight, so all distances are even. At a
distance of 8 three wrong bits can be corrected within the set, at 6 two, at 4 one, at 2 none.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.marker.code import IDS, PACKET_BITS, RESERVED_IDS, check_ids, packet

SAFE_DISTANCE = 8  # what the Golay code gives at the right start: three wrong bits do no harm

USABLE_IDS: NDArray[np.int64] = np.setdiff1d(np.arange(IDS), RESERVED_IDS)


class ConfusablePair(NamedTuple):
    """Two markers, or one with itself, that come close at some start bit."""

    first: int
    second: int  # the higher ID, or again the first
    distance: int  # in how many bits they differ; 0 if the ID is in the set more than once
    shift: int  # start bit of `first`, 0 to 30, at which it is so close to the packet of `second`


def distances(ids: ArrayLike) -> NDArray[np.uint8]:
    """Return the distances of IDs (n,) at any start bit, (n, n): on the diagonal to themselves."""
    # Bits as ±1: the product of two packets is how many bits agree less how many differ, and as
    # integers below 2^24 are exact in float32, so is the product.
    signs = 1 - 2 * packet(ids).astype(np.float32)
    agreement = np.full((len(signs), len(signs)), -PACKET_BITS, dtype=np.int8)
    # The other half of the shifts are these with the two IDs exchanged.
    for shift in range(PACKET_BITS // 2 + 1):
        products = (signs @ np.roll(signs, shift, axis=1).T).astype(np.int8)
        if shift == 0:
            np.fill_diagonal(products, -PACKET_BITS)
        np.maximum(agreement, products, out=agreement)
    differing: NDArray[np.int8] = (PACKET_BITS - np.maximum(agreement, agreement.T)) // 2
    return differing.astype(np.uint8)


def choose_ids(count: int, min_distance: int | None = None) -> tuple[NDArray[np.int64], int]:
    """Choose 1 to 4094 usable IDs that are far apart, each also from its own shifts.

    The smallest distance allowed is 1 to 31 bits, by default the largest at which so many are
    found. Returns the IDs in the order of choice, shape (count,), and their smallest distance.
    ValueError if a number is out of range, or so many are not found.
    """
    if not 1 <= count <= len(USABLE_IDS):
        raise ValueError(f'{count} IDs cannot be chosen: ask for 1 to {len(USABLE_IDS)}')
    if min_distance is None:
        wanted = int(_usable_distances().max())
        while len(ids := largest_set(wanted, count)) < count:
            wanted -= 2  # there are no odd ones
    elif len(ids := largest_set(min_distance, count)) < count:
        raise ValueError(
            f'{count} IDs at a distance of {min_distance} bits were not found, only '
            f'{len(ids)}: ask for fewer, or for a smaller distance'
        )
    places = np.searchsorted(USABLE_IDS, ids)
    return ids, int(_usable_distances()[np.ix_(places, places)].min())


def largest_set(min_distance: int, count: int = len(USABLE_IDS)) -> NDArray[np.int64]:
    """Return all IDs found at a minimum distance, or `count` of them; ValueError as above.

    The next ID is always the one that rules out the fewest of those left, the lowest of several.
    Larger sets may exist, but the choice is the same everywhere, and a set can grow later: a
    smaller one is the beginning of a larger one.
    """
    _check_distance(min_distance)
    near = _usable_distances() < min_distance
    left = ~near.diagonal()
    conflicts = near[left].sum(axis=0)
    chosen: list[int] = []
    while len(chosen) < count and left.any():
        best = int(np.where(left, conflicts, len(near)).argmin())
        chosen.append(best)
        taken = left & near[best]
        taken[best] = True
        left &= ~taken
        conflicts -= near[taken].sum(axis=0)
    return USABLE_IDS[chosen]


def confusable_pairs(ids: ArrayLike, min_distance: int = SAFE_DISTANCE) -> list[ConfusablePair]:
    """Return the pairs of a set of IDs that are nearer than `min_distance`, nearest first.

    An ID near its own shifts is paired with itself, and so, at distance 0, is one that occurs
    twice. Errors are as of `distances` and `choose_ids`.
    """
    _check_distance(min_distance)
    unique, occurrences = np.unique(check_ids(ids), return_counts=True)
    pairs = [ConfusablePair(marker, marker, 0, 0) for marker in unique[occurrences > 1].tolist()]
    first, second = np.nonzero(np.triu(distances(unique) < min_distance))
    sent, other = packet(unique[first]), packet(unique[second])
    differing = np.array(
        [(np.roll(sent, -shift, axis=1) != other).sum(axis=1) for shift in range(PACKET_BITS)]
    )
    differing[0, first == second] = PACKET_BITS
    found = (unique[first], unique[second], differing.min(axis=0), differing.argmin(axis=0))
    pairs += map(ConfusablePair, *(column.tolist() for column in found))
    return sorted(pairs, key=lambda pair: (pair.distance, pair.first, pair.second))


@lru_cache(maxsize=1)
def _usable_distances() -> NDArray[np.uint8]:
    """Return the distances among the usable IDs, 16 MB that take a second."""
    apart = distances(USABLE_IDS)
    apart.flags.writeable = False
    return apart


def _check_distance(min_distance: int) -> None:
    if not 1 <= min_distance <= PACKET_BITS:
        raise ValueError(f'a distance of {min_distance} bits is outside 1..{PACKET_BITS}')
