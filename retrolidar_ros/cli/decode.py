# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Print what is read in a bag."""

from __future__ import annotations

import argparse

from retrolidar_ros.bag import read_frames
from retrolidar_ros.cli.arguments import Subparsers, add_bag_command
from retrolidar_ros.detector.decoding import TEXT_HEADER, detect, to_json, to_text


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar decode`."""
    command = add_bag_command(subparsers, 'decode', 'read the markers in a bag', run)
    command.add_argument('--json', action='store_true', help='one JSON object a line')


def run(arguments: argparse.Namespace) -> int:
    """Print detections as lines of JSON or as a table."""
    detections = detect(read_frames(arguments.bag, arguments.topic), arguments.method)
    for index, detection in enumerate(detections):
        if index == 0 and not arguments.json:
            print(TEXT_HEADER)
        print(to_json(detection) if arguments.json else to_text(detection))
    return 0
