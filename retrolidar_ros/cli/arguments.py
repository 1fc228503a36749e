# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Values of arguments that several subcommands take."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TypeAlias

from retrolidar_ros.bag import FRAMES_TOPIC
from retrolidar_ros.detector import METHODS

Subparsers: TypeAlias = 'argparse._SubParsersAction[argparse.ArgumentParser]'
_MOST_SECONDS = 1e9
Run = Callable[[argparse.Namespace], int]


def number_of_seconds(text: str) -> float:
    """Parse a time in seconds."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text} is no number of seconds') from None


def seconds(text: str) -> float:
    """Parse a duration in seconds."""
    value = number_of_seconds(text)
    if not 0 < value <= _MOST_SECONDS:
        raise argparse.ArgumentTypeError(
            f'{text} is no positive number of seconds up to {_MOST_SECONDS:.0f}'
        )
    return value


def add_bag_command(
    subparsers: Subparsers, name: str, summary: str, run: Run
) -> argparse.ArgumentParser:
    """Add a subcommand that reads markers in a bag."""
    command = subparsers.add_parser(name, help=summary)
    command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    command.add_argument('--topic', default=FRAMES_TOPIC, help='(default: %(default)s)')
    command.add_argument(
        '--method', choices=METHODS, default=METHODS[0], help='(default: %(default)s)'
    )
    command.set_defaults(run=run)
    return command
