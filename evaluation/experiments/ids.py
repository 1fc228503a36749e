# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How many IDs there are that are hard to confuse, and how many random words the code accepts."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.report.charts import look, new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.marker.code import IDS, MAX_CORRECTED_BITS, WORD_BITS, decode
from retrolidar_ros.marker.dictionary import USABLE_IDS, largest_set

TITLE = 'Sets of IDs, and what the code accepts'
SOURCE = 'paper §3.4, §6.2'
PAPER_IDS = 4096
_DISTANCES = (12, 10, 8, 6, 4, 2)
_WORDS, _QUICK_WORDS = 1_000_000, 100_000


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return the sizes of sets by least distance, and the share of random words accepted."""
    words = _QUICK_WORDS if quick else _WORDS
    decoded, _ = decode(rng.integers(0, 2, (words, WORD_BITS), dtype=np.uint8))
    return {
        'usable': len(USABLE_IDS),
        'sets': [
            {'distance': distance, 'ids': len(largest_set(distance))} for distance in _DISTANCES
        ],
        'random_words': words,
        'accepted': float(np.mean(decoded >= 0)),
        # Spheres of three errors about all words, which do not overlap.
        'accepted_by_count': IDS
        * sum(math.comb(WORD_BITS, wrong) for wrong in range(MAX_CORRECTED_BITS + 1))
        / 2**WORD_BITS,
    }


def summarise(figures: dict[str, Any]) -> str:
    """Return the sizes of the sets."""
    lines = [f'{row["ids"]:5d} IDs at {row["distance"]:2d} bits' for row in figures['sets']]
    lines.append(
        f'{figures["accepted"]:.1%} of {figures["random_words"]} random words give an ID; '
        f'counted, {figures["accepted_by_count"]:.1%}'
    )
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the number of IDs, and what the code accepts, beside the paper's."""
    safe = next(row['ids'] for row in figures['sets'] if row['distance'] == 8)
    return [
        Claim(
            'IDs',
            f'{PAPER_IDS} (12 bits)',
            default=f'{figures["usable"]}; {safe} that three wrong bits never turn into another',
        ),
        Claim(
            'random words that the Golay code takes for an ID',
            '"negligible"',
            f'{figures["accepted"]:.1%}',
            'evidence decides, not the code',
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say why not all IDs are as good."""
    return (
        'Read from its first bit, any two packets differ in eight bits or more. A repeating marker '
        'is read from any bit, and there a packet may come nearer to another one; the distance '
        'here is the least over all shifts. The search for sets is greedy, so there may be larger '
        'ones. The words of 0 and 4095 never change and are left out.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw the sizes of the sets."""
    figure, ((axis,),) = new_chart(1, 1, 8, 4.2)
    places = range(len(figures['sets']))
    sizes = [row['ids'] for row in figures['sets']]
    axis.bar(places, sizes, color=look('joint')['color'])
    for place, size in zip(places, sizes, strict=True):
        axis.annotate(
            f'{size}', (place, size), xytext=(0, 3), textcoords='offset points', ha='center'
        )
    axis.set_yscale('log')
    axis.set_ylim(1, 2 * max(sizes))
    axis.set_xticks(places, [f'{row["distance"]}' for row in figures['sets']])
    axis.set_xlabel('least distance, over all shifts [bits]')
    axis.set_ylabel('IDs found')
    figure.savefig(path)
