# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate parameters and a scene from a recording, and describe them on a page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import yaml

from retrolidar_ros.bag import FRAMES_TOPIC, salvage_frames
from retrolidar_ros.cli.arguments import Subparsers
from retrolidar_ros.cli.calibration_page import write_page
from retrolidar_ros.cli.decode import NOTHING_READ
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.settings.section import quantity
from retrolidar_ros.tasks.calibration.calibrate import calibrate
from retrolidar_ros.tasks.calibration.files import parameter_file, scene
from retrolidar_ros.tasks.calibration.sentences import missing, sentences


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar calibrate`."""
    command = subparsers.add_parser(
        'calibrate',
        help='estimate the parameters of a recorded sensor and its markers',
        description='Writes calibration.yaml, a params_file of the nodes and of decode; '
        'scene.yaml, for the emulator; and calibration.md with calibration.png. Only what the '
        f'recording shows is written. Exit code {NOTHING_READ} if no marker is read.',
    )
    command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    command.add_argument('--topic', default=FRAMES_TOPIC, help='(default: %(default)s)')
    command.add_argument('--distance', help="from sensor to brightest marker, as in '1.2 m'")
    command.add_argument('--size', default='3 cm', help='edge of markers (default: %(default)s)')
    command.add_argument('--speed', help="of a marker swept straight across, a second: '5 cm'")
    command.add_argument(
        '-o',
        '--output',
        type=Path,
        default=Path('calibration'),
        metavar='DIR',
        help='(default: %(default)s)',
    )
    command.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate from a bag, as far as it can be read."""

    def length(name: str, least: float, most: float) -> float | None:
        text = getattr(arguments, name)
        return None if text is None else quantity('length', least, most)(text, f'--{name}')

    distance_m, speed_m_s = length('distance', 0.05, 10), length('speed', 1e-3, 10)
    size_m = quantity('length', 1e-3, 1)(arguments.size, '--size')
    frames, damage = salvage_frames(arguments.bag, arguments.topic)
    found = calibrate(
        Recording.of(frames), distance_m=distance_m, size_m=size_m, speed_m_s=speed_m_s
    )
    source = arguments.bag.name
    lines, wanted = sentences(found), missing(found)
    arguments.output.mkdir(parents=True, exist_ok=True)
    files = {
        'calibration.yaml': parameter_file(found, source),
        'scene.yaml': yaml.safe_dump(scene(found, source), sort_keys=False, allow_unicode=True),
    }
    for name, text in files.items():
        (arguments.output / name).write_text(text, encoding='utf-8')
    write_page(found, lines, wanted, arguments.output, source)
    print('\n'.join([*lines, *(f'Next: {line}' for line in wanted)]))
    print(f'{arguments.output}: {", ".join(files)}, calibration.md, calibration.png')
    if damage is not None:
        print(f'retrolidar: only what comes before the damage: {damage}', file=sys.stderr)
    return 0 if found.markers else NOTHING_READ
