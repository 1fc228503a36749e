# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Print the detections or tracks in a bag."""

import argparse
import sys

from retrolidar_ros.bag import read_frames
from retrolidar_ros.cli.arguments import add_bag, add_detector_options, detector_values
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.findings import Finding
from retrolidar_ros.detector.text import (
    TEXT_HEADER,
    TRACK_HEADER,
    to_json,
    to_text,
    track_to_json,
    track_to_text,
)

NOTHING_READ = 3  # exit code
HELP = 'read the markers in a bag'
DESCRIPTION = (
    'If markers could be read better, standard error says why. '
    f'Exit code {NOTHING_READ} if nothing is read.'
)


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_bag(command)
    add_detector_options(command)
    command.add_argument('--json', action='store_true', help='print one JSON object per line')
    command.add_argument(
        '--tracks',
        action='store_true',
        help='print where each marker is at every frame, once it is read',
    )
    command.add_argument('--explain', action='store_true', help='describe every blinking zone')


def run(arguments: argparse.Namespace) -> int:
    """Print detections or tracks as JSON lines or a table, and why markers are not read."""
    decoding = Decoding(detector_values(arguments))
    frames = read_frames(arguments.bag, arguments.topic)
    if arguments.tracks:
        header, tracks = TRACK_HEADER, decoding.follow(frames)
        lines = map(track_to_json if arguments.json else track_to_text, tracks)
    else:
        header, detections = TEXT_HEADER, decoding.detect(frames)
        lines = map(to_json if arguments.json else to_text, detections)
    for number, line in enumerate(lines):
        if not arguments.json and not number:
            print(header)
        print(line)
    sys.stdout.flush()
    print_hints(decoding, describe=arguments.explain)
    return 0 if decoding.detections else NOTHING_READ


def print_hints(decoding: Decoding, *, describe: bool = False) -> list[Finding]:
    """Print to standard error, and return, why markers are not read; zones on demand."""
    explanation = decoding.explanation()
    findings = explanation.findings()
    lines = [str(one) for one in findings]
    if describe:
        lines += decoding.table(explanation, findings)
    for line in lines:
        print(line, file=sys.stderr)
    return findings
