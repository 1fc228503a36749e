# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Link, wake-up and battery life to expect of a marker."""

from __future__ import annotations

import argparse
import json

from retrolidar_ros.cli.arguments import Subparsers


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar budget`."""
    command = subparsers.add_parser(
        'budget',
        help='expected link, wake-up and battery life of a marker',
        description='Quantities carry their units, as in scene files.',
    )
    for name, default, what in (
        ('size', '3 cm', 'edge of the retroreflector'),
        ('yaw', '0 deg', "angle between the marker's normal and the line of sight"),
        ('distance', '2 m', 'from the sensor'),
        ('cell', '90 mAh', 'capacity of the battery'),
        ('queries', '1', 'packets an hour'),
    ):
        command.add_argument(f'--{name}', default=default, help=f'{what} (default: %(default)s)')
    command.add_argument('--json', action='store_true', help='one JSON object')
    command.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Print what to expect of a marker."""
    from retrolidar_ros.scene.marker_budget import budget, parse_case, to_json, to_text

    case = parse_case(
        arguments.size, arguments.yaw, arguments.distance, arguments.cell, arguments.queries
    )
    found = budget(case)
    print(json.dumps(to_json(found)) if arguments.json else to_text(found))
    return 0
