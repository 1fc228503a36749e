# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Print the detections in a bag."""

from __future__ import annotations

import argparse
import sys

from retrolidar_ros.bag import read_frames
from retrolidar_ros.cli.arguments import Subparsers, add_bag_command, detector_values
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.text import TEXT_HEADER, to_json, to_text

NOTHING_READ = 3


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar decode`."""
    command = add_bag_command(
        subparsers,
        'decode',
        'read the markers in a bag',
        run,
        'If markers could be read better, standard error says why. '
        f'Exit code {NOTHING_READ} if nothing is read.',
    )
    command.add_argument('--json', action='store_true', help='one JSON object a line')
    command.add_argument('--explain', action='store_true', help='describe every blinking zone')


def run(arguments: argparse.Namespace) -> int:
    """Print detections as lines of JSON or as a table, and why there are not more."""
    decoding = Decoding(detector_values(arguments))
    if not arguments.json:
        print(TEXT_HEADER)
    for detection in decoding.detect(read_frames(arguments.bag, arguments.topic)):
        print(to_json(detection) if arguments.json else to_text(detection))
    sys.stdout.flush()
    for line in [*decoding.why(), *(decoding.table() if arguments.explain else [])]:
        print(line, file=sys.stderr)
    return 0 if decoding.packets else NOTHING_READ
