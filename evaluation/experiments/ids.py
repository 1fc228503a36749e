# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many IDs there are that are hard to confuse, and how many random words the code accepts."""

from typing import Any

import numpy as np

from evaluation.report.claims import Claim, Claims, Table, model
from retrolidar_ros.marker import code
from retrolidar_ros.marker.dictionary import USABLE_IDS, largest_set

TITLE = 'Sets of IDs, and what the code accepts'
_DISTANCES = (12, 10, 8, 6, 4, 2)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return the sizes of sets by least distance, and the share of random words accepted."""
    words = 10_000 if quick else 1_000_000
    decoded, _ = code.decode(rng.integers(0, 2, (words, code.WORD_BITS), dtype=np.uint8))
    return {
        'usable': len(USABLE_IDS),
        'sets': [
            {'distance': distance, 'ids': len(largest_set(distance))} for distance in _DISTANCES
        ],
        'accepted': float(np.mean(decoded >= 0)),
    }


def table(figures: dict[str, Any]) -> Table:
    """Return the sizes of the sets."""
    sets = figures['sets']
    return [
        ['least distance [bits]', *(str(row['distance']) for row in sets)],
        ['IDs found', *(str(row['ids']) for row in sets)],
    ]


def claims(figures: dict[str, Any]) -> Claims:
    """Return the number of IDs, and what the code accepts."""
    return {
        'ids': model(f'{figures["usable"]}'),
        'random': Claim(f'{figures["accepted"]:.1%}', 'evidence decides'),
    }
