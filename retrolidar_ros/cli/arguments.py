# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Values of arguments that several subcommands take."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from retrolidar_ros.bag import FRAMES_TOPIC
from retrolidar_ros.detector.parameters import PARAMETERS, checked, defaults, load_parameters
from retrolidar_ros.sensor.protocols import PROTOCOLS

Subparsers: TypeAlias = 'argparse._SubParsersAction[argparse.ArgumentParser]'
_MOST_SECONDS = 1e9
Run = Callable[[argparse.Namespace], int]
_METAVARS = {str: 'TEXT', int: 'N', float: 'NUMBER', list: 'ID,ID,…'}


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


def add_port(command: argparse.ArgumentParser) -> None:
    """Add the port and the protocol of a sensor."""
    command.add_argument('port', metavar='PORT', help='device of the sensor')
    command.add_argument('--baud', type=int, default=460800, help='bit/s (default: %(default)s)')
    command.add_argument(
        '--protocol',
        choices=PROTOCOLS,
        default='retrolidar',
        help='protocol of the sensor (default: %(default)s)',
    )


def add_detector_options(command: argparse.ArgumentParser) -> None:
    """Add the parameters of the detector node as options of the same names."""
    options = command.add_argument_group(
        'parameters of the detector', 'as those of the node; options override the file'
    )
    options.add_argument(
        '--params', type=Path, metavar='FILE', help='parameter file, as of `retrolidar calibrate`'
    )
    usual = defaults()
    for name, one in PARAMETERS.items():
        dashed = f'--{name.replace("_", "-")}'
        names = list(dict.fromkeys([dashed, f'--{name}']))
        description = f'{one.description} (default: {usual[name]!r})'
        if one.kind is bool:
            options.add_argument(
                *names, dest=name, action='store_const', const=True, help=description
            )
            continue
        options.add_argument(
            *names,
            dest=name,
            type=str if one.among else partial(_value, name),
            choices=one.among or None,
            metavar=None if one.among else _METAVARS[one.kind],
            help=description,
        )


def _value(name: str, text: str) -> Any:
    """Parse a parameter."""
    kind = PARAMETERS[name].kind
    try:
        value = [int(part) for part in text.split(',') if part] if kind is list else kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text} is no {_METAVARS[kind]}') from None
    try:
        return checked(name, value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def detector_values(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return all parameters: of the options, else the file, else the defaults."""
    given = {name: getattr(arguments, name) for name in PARAMETERS}
    return {
        **defaults(),
        **(load_parameters(arguments.params) if arguments.params else {}),
        **{name: value for name, value in given.items() if value is not None},
    }


def add_bag_command(
    subparsers: Subparsers, name: str, summary: str, run: Run, description: str = ''
) -> argparse.ArgumentParser:
    """Add a subcommand that reads markers in a bag."""
    command = subparsers.add_parser(name, help=summary, description=description or None)
    command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    command.add_argument('--topic', default=FRAMES_TOPIC, help='(default: %(default)s)')
    add_detector_options(command)
    command.set_defaults(run=run)
    return command
