# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw what is read in a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from retrolidar_ros.bag import BagError, read_frames
from retrolidar_ros.cli.arguments import Subparsers, add_bag_command
from retrolidar_ros.cli.picture import Reading, plot_readings
from retrolidar_ros.detector.decoding import detect
from retrolidar_ros.sensor.frame import Frame, Recording


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar plot`."""
    command = add_bag_command(subparsers, 'plot', 'draw what was read in a bag', run)
    command.add_argument('-o', '--output', type=Path, required=True, help='PNG file')


def run(arguments: argparse.Namespace) -> int:
    """Draw a bag, as far as it can be read."""
    if arguments.output.is_dir():
        raise IsADirectoryError(f'{arguments.output} is a directory; name a PNG file')
    frames: list[Frame] = []
    damage = None
    try:
        frames.extend(read_frames(arguments.bag, arguments.topic))
    except BagError as error:
        if not frames:
            raise
        damage = error
    origin_ns = frames[0].stamp_ns
    readings = [Reading.of(detection, origin_ns) for detection in detect(frames, arguments.method)]
    plot_readings(
        Recording.of(frames),
        readings,
        arguments.output,
        origin_ns=origin_ns,
        title=f'{arguments.bag.name}: {len(frames)} frames, {len(readings)} readings',
    )
    print(f'{arguments.output}: {len(frames)} frames, {len(readings)} readings')
    if damage is not None:
        raise damage
    return 0
