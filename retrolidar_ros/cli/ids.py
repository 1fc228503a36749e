# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Choose IDs that are hard to confuse, or check given ones."""

import argparse
import sys

from retrolidar_ros.marker.code import RESERVED_IDS
from retrolidar_ros.marker.dictionary import SAFE_DISTANCE, choose_ids, confusable_pairs, distances

HELP = 'choose marker IDs that are hard to confuse, or check given ones'
DESCRIPTION = (
    'A repeating marker may be read from any bit. So the distance of two IDs is the fewest bits, '
    'of 31, in which the packet of one differs from any cyclic shift of the packet of the other. '
    'At a distance of 8 three wrong bits do not turn one ID into the other, at 6 two, at 4 one, '
    'at 2 none. An ID also has a distance to itself, over all shifts but 0.'
)


def marker_ids(text: str) -> list[int]:
    """Parse IDs between commas."""
    try:
        return [int(part) for part in text.split(',')]
    except ValueError:
        message = f'{text!r} is no list of IDs such as 3,17,42'
        raise argparse.ArgumentTypeError(message) from None


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    task = command.add_mutually_exclusive_group(required=True)
    task.add_argument('--count', type=int, metavar='N', help='print this many IDs, one per line')
    task.add_argument(
        '--check',
        type=marker_ids,
        metavar='ID,ID,…',
        help='print the pairs that are too near; exit code 1 if there are any',
    )
    command.add_argument(
        '--min-distance',
        type=int,
        metavar='BITS',
        help='minimum distance (default: with --count the largest possible, with --check 8)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Choose IDs, or check them."""
    if arguments.count is not None:
        ids, minimum = choose_ids(arguments.count, arguments.min_distance)
        print(*ids, sep='\n')
        print(f'IDs: {len(ids)}, least distance: {minimum} bits', file=sys.stderr)
        return 0

    limit = SAFE_DISTANCE if arguments.min_distance is None else arguments.min_distance
    pairs = confusable_pairs(arguments.check, limit)
    reserved = sorted(set(arguments.check) & set(RESERVED_IDS))
    minimum = int(distances(arguments.check).min())
    print(f'IDs: {len(arguments.check)}, least distance: {minimum} bits')
    for marker_id in reserved:
        print(f'{marker_id} is reserved: after the preamble it never changes')
    for first, second, distance, shift in pairs:
        if distance == 0:
            print(f'{first} is there more than once')
        else:
            other = 'itself' if second == first else second
            print(f'{first} read from bit {shift} differs from {other} in {distance} bits')
    return 1 if reserved or pairs else 0
