# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Values of arguments that several subcommands take."""

import argparse
import re
from collections.abc import Callable
from difflib import get_close_matches
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from retrolidar_ros.bag import FRAMES_TOPIC, STORAGES
from retrolidar_ros.detector.parameters import READING, defaults, load_parameters
from retrolidar_ros.settings.parameter import declared
from retrolidar_ros.settings.printing import printable
from retrolidar_ros.settings.section import ConfigError, integer, quantity
from retrolidar_ros.settings.section import Parser as Parse

T = TypeVar('T')
_MAX_VALUE = 1e9
_UNITS = {'bit_period': 'time', 'range_offset': 'length'}
_METAVARS = {str: 'TEXT', int: 'INTEGER', float: 'NUMBER', list: 'ID,ID,…'}


class Parser(argparse.ArgumentParser):
    """Prints an error in one line, and where the help is."""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse arguments; one that is unknown is an error of the subcommand."""
        found, unknown = super().parse_known_args(args, namespace)
        if unknown:
            near = get_close_matches(unknown[0].partition('=')[0], self._option_string_actions, n=1)
            hint = f'; did you mean {near[0]}?' if near else ''
            self.error(f'unrecognized arguments: {" ".join(unknown)}{hint}')
        return found, unknown

    def error(self, message: str) -> NoReturn:
        """Print an error and exit with code 2."""
        self.exit(2, f'{self.prog}: {printable(message)}\nSee {self.prog} --help\n')


def measured(kind: str, minimum: float, maximum: float) -> Callable[[str], float]:
    """Return a parser of quantities with units, or bare in the code's unit."""
    return _argument(quantity(kind, minimum, maximum, bare=True))


def whole(minimum: int, maximum: int) -> Callable[[str], int]:
    """Return a parser of whole numbers within limits."""
    parse = integer(minimum, maximum)
    return _argument(
        lambda text, path: parse(int(text) if re.fullmatch(r'-?\d+', text) else text, path)
    )


def _argument(parse: Parse[T]) -> Callable[[str], T]:
    def parsed(text: str) -> T:
        try:
            return parse(text, '')
        except ConfigError as error:
            raise argparse.ArgumentTypeError(str(error).removeprefix(': ')) from None

    return parsed


seconds = measured('time', 1e-3, 1e9)  # parse a duration


def output_path(text: str) -> Path:
    """Parse the path of a file or directory to make; like other tools, none above it is made."""
    path = Path(text)
    if not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f'there is no directory {path.parent}; make it first')
    return path


def add_port(command: argparse.ArgumentParser) -> None:
    """Add the port and the protocol of a sensor."""
    command.add_argument('port', metavar='PORT', help='device of the sensor')
    for option, name in (('--baud', 'serial_baud'), ('--protocol', 'protocol')):
        one = declared()['driver'][name]
        command.add_argument(
            option,
            type=partial(_value, 'driver', name),
            choices=one.among or None,
            default=one.default,
            help=f'{one.summary()} (default: %(default)s)',
        )


def add_detector_options(command: argparse.ArgumentParser) -> None:
    """Add the parameters of the detector node as options of the same names."""
    options = command.add_argument_group(
        'parameters of the detector', 'as those of the node; options override the file'
    )
    options.add_argument(
        '--params',
        type=Path,
        metavar='FILE',
        help='parameter file, such as `retrolidar calibrate` writes',
    )
    for name in READING:
        one = declared()['detector'][name]
        option = f'--{name.replace("_", "-")}'
        description = f'{one.summary()} (default: {one.default!r})'
        kind = type(one.default)
        how: dict[str, Any] = {'choices': one.among}
        if kind is bool:
            how = {'action': 'store_const', 'const': True}
        elif not one.among:
            metavar = _UNITS.get(name, _METAVARS[kind]).upper()
            how = {'type': partial(_value, 'detector', name), 'metavar': metavar}
        options.add_argument(option, dest=name, help=description, **how)


def _value(node: str, name: str, text: str) -> Any:
    one = declared()[node][name]
    kind = type(one.default)
    try:
        if name in _UNITS:
            value: Any = measured(_UNITS[name], -_MAX_VALUE, _MAX_VALUE)(text)
        else:
            value = [int(part) for part in text.split(',') if part] if kind is list else kind(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text} is no {_METAVARS[kind]}') from None
    try:
        return one.check(name, value)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def detector_values(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return all parameters: of the options, else the file, else the defaults."""
    given = {name: getattr(arguments, name) for name in READING}
    return {
        **defaults(),
        **(load_parameters(arguments.params) if arguments.params else {}),
        **{name: value for name, value in given.items() if value is not None},
    }


def add_storage(command: argparse.ArgumentParser) -> None:
    """Add the storage of a bag to write."""
    command.add_argument(
        '--storage',
        choices=STORAGES,
        default=STORAGES[0],
        help='storage of the bag (default: %(default)s)',
    )


def add_bag(command: argparse.ArgumentParser) -> None:
    """Add a bag and a topic in it."""
    command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    command.add_argument(
        '--topic', default=FRAMES_TOPIC, help='topic in the bag (default: %(default)s)'
    )
