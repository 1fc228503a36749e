# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw the detections in a bag."""

import argparse

from retrolidar_ros.bag import salvage_frames
from retrolidar_ros.cli.arguments import add_bag, add_detector_options, detector_values, output_path
from retrolidar_ros.cli.decode import NOTHING_READ, print_hints
from retrolidar_ros.cli.picture import plot_readings
from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.detection import Track
from retrolidar_ros.sensor.frame import Recording

HELP = 'draw what was read in a bag'


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_bag(command)
    add_detector_options(command)
    command.add_argument(
        '-o', '--output', type=output_path, required=True, help='PNG file to write'
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw a bag, as far as it can be read."""
    if arguments.output.is_dir():
        raise IsADirectoryError(f'{arguments.output} is a directory; name a PNG file')
    frames, damage = salvage_frames(arguments.bag, arguments.topic)
    decoding = Decoding(detector_values(arguments))
    readings: list[Detection] = []
    tracks: list[Track] = []
    for detections, followed in decoding.steps(frames, follow=True):
        readings += detections
        tracks += followed
    explanation = decoding.explanation()
    hints = print_hints(decoding, explanation)
    plot_readings(
        Recording.of(frames),
        readings,
        arguments.output,
        tracks=tracks,
        title=f'{arguments.bag.name}: {len(frames)} frames, {len(readings)} readings',
        hint=str(hints[0]) if hints else '',
        blinking=() if readings else explanation.zones,
    )
    print(f'{arguments.output}: {len(frames)} frames, {len(readings)} readings')
    if damage is not None:
        raise damage
    return 0 if readings else NOTHING_READ
