# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `retrolidar` command: its arguments and its errors."""

from __future__ import annotations

import argparse
import os
import sys
from contextlib import suppress
from pathlib import Path

# Many threads make the detector's small matrix products slower. numpy reads this once, when it is
# imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from retrolidar_ros import commands
from retrolidar_ros.bag import FRAMES_TOPIC, STORAGES, BagError
from retrolidar_ros.code import BIT_PERIOD_LIMITS_S, BIT_PERIOD_S
from retrolidar_ros.detector import METHODS
from retrolidar_ros.frame import ZONE_SHAPES
from retrolidar_ros.protocols import PROTOCOLS
from retrolidar_ros.section import ConfigError


def marker_ids(text: str) -> list[int]:
    """Parse IDs between commas."""
    try:
        return [int(part) for part in text.split(',')]
    except ValueError:
        message = f'{text!r} is no list of IDs such as 3,17,42'
        raise argparse.ArgumentTypeError(message) from None


def number_of_seconds(text: str) -> float:
    """Parse a time in seconds."""
    try:
        return float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f'{text} is no number of seconds') from None


def seconds(text: str) -> float:
    """Parse a duration in seconds."""
    value = number_of_seconds(text)
    if not value > 0:
        raise argparse.ArgumentTypeError(f'{text} is no positive number of seconds')
    return value


def zone_index(text: str) -> int:
    """Parse the index of a zone of the largest grid."""
    zones = range(max(rows * columns for rows, columns in ZONE_SHAPES))
    with suppress(ValueError):
        if (zone := int(text)) in zones:
            return zone
    raise argparse.ArgumentTypeError(f'{text} is no zone: they are 0 to 15, or 0 to {zones[-1]}')


def bit_period(text: str) -> float:
    """Parse how long a marker holds a bit in seconds."""
    value = number_of_seconds(text)
    least, most = BIT_PERIOD_LIMITS_S
    if not least <= value <= most:
        raise argparse.ArgumentTypeError(f'{text} s is not within {least:g} to {most:g} s')
    return value


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='retrolidar', description='Read liquid-crystal fiducial markers with a LiDAR.'
    )
    subparsers = parser.add_subparsers(required=True, metavar='COMMAND')

    demo = subparsers.add_parser(
        'demo', help='run emulated sensor, driver and detector, and compare with the truth'
    )
    demo.add_argument('scene', nargs='?', default='coffee', help='name or file (default: coffee)')
    demo.add_argument('-o', '--output', type=Path, help='picture (default: demo_SCENE.png)')
    demo.add_argument('--timeout', type=seconds, default=60.0, help='give up after [s]')
    demo.set_defaults(run=commands.demo)

    emulate = subparsers.add_parser('emulate', help='be a sensor that sees a scene')
    emulate.add_argument('scene', help='name or file')
    where = emulate.add_mutually_exclusive_group(required=True)
    where.add_argument('--port-link', type=Path, help='in real time, at a serial port linked here')
    where.add_argument('--bag', type=Path, help='at once, into a new rosbag2 directory')
    emulate.add_argument(
        '--storage', choices=STORAGES, default=STORAGES[0], help='of the bag (default: %(default)s)'
    )
    emulate.add_argument('--duration', type=seconds, help='stop after [s]')
    emulate.set_defaults(run=commands.emulate)

    look = subparsers.add_parser(
        'watch',
        help='show live what a sensor sees, zone by zone and bit by bit',
        description='On a terminal a picture five times a second, else a line a second. Ctrl-C '
        'ends it. Exit code 1 if a duration ends without any frame.',
    )
    look.add_argument('port', metavar='PORT', help='device of the sensor')
    look.add_argument('--baud', type=int, default=460800, help='bit/s (default: %(default)s)')
    look.add_argument(
        '--protocol',
        choices=PROTOCOLS,
        default='retrolidar',
        help='what the sensor speaks (default: %(default)s)',
    )
    look.add_argument(
        '--zone',
        type=zone_index,
        metavar='N',
        help='whose bits to show (default: the one that blinks most)',
    )
    look.add_argument(
        '--bit-period',
        type=bit_period,
        default=BIT_PERIOD_S,
        metavar='S',
        help='how long a marker holds a bit: two frames [s] (default: %(default)s)',
    )
    look.add_argument('--duration', type=seconds, metavar='S', help='stop after [s]')
    look.set_defaults(run=commands.watch)

    def add_bag_command(name: str, summary: str) -> argparse.ArgumentParser:
        command = subparsers.add_parser(name, help=summary)
        command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
        command.add_argument('--topic', default=FRAMES_TOPIC, help='(default: %(default)s)')
        command.add_argument(
            '--method', choices=METHODS, default=METHODS[0], help='(default: %(default)s)'
        )
        return command

    decode = add_bag_command('decode', 'read the markers in a bag')
    decode.add_argument('--json', action='store_true', help='one JSON object a line')
    decode.set_defaults(run=commands.decode)

    plot = add_bag_command('plot', 'draw what was read in a bag')
    plot.add_argument('-o', '--output', type=Path, required=True, help='PNG file')
    plot.set_defaults(run=commands.plot)

    ids = subparsers.add_parser(
        'ids',
        help='choose marker IDs that are hard to confuse, or check those in use',
        description='The distance of two IDs is the fewest bits, of 31, in which the packet of one '
        'differs from that of the other when the reading of a repeating marker starts at any bit. '
        'At a distance of 8, which the Golay code has when read from the first bit, three wrong '
        'bits do not turn one into the other; at 6 two, at 4 one, at 2 none. An ID has a distance '
        'to itself too, read from any bit but the first.',
    )
    task = ids.add_mutually_exclusive_group(required=True)
    task.add_argument('--count', type=int, metavar='N', help='print so many IDs, one a line')
    task.add_argument(
        '--check',
        type=marker_ids,
        metavar='ID,ID,…',
        help='name the pairs that are too near; exit code 1 if there are any',
    )
    ids.add_argument(
        '--min-distance',
        type=int,
        metavar='BITS',
        help='least distance allowed (default: to choose, the largest possible; to check, 8)',
    )
    ids.set_defaults(run=commands.ids)

    expected = subparsers.add_parser(
        'budget',
        help='tell what to expect of a marker: its link, its waking and its battery',
        description='The link is simulated: markers before a wall, each awake for one packet. '
        'Quantities carry their units, as in scene files.',
    )
    for name, default, what in (
        ('size', '3 cm', 'edge of the retroreflector'),
        ('yaw', '0 deg', "angle between the marker's normal and the line of sight"),
        ('distance', '2 m', 'from the sensor'),
        ('cell', '90 mAh', 'capacity of the battery'),
        ('queries', '1', 'packets an hour'),
    ):
        expected.add_argument(f'--{name}', default=default, help=f'{what} (default: %(default)s)')
    expected.add_argument('--json', action='store_true', help='one JSON object')
    expected.set_defaults(run=commands.budget)

    evaluate = subparsers.add_parser(
        'evaluate',
        help='run experiments and draw their charts',
        description='Run experiments on emulated frames; without any name, list them. Each writes '
        'NAME.json and NAME.png; --all also writes a page of Markdown that tells of all of them.',
    )
    which = evaluate.add_mutually_exclusive_group()
    which.add_argument('names', nargs='*', default=[], metavar='NAME', help='which to run')
    which.add_argument('--all', action='store_true', help='all of them, and the page')
    evaluate.add_argument('--quick', action='store_true', help='few trials: a look at each')
    evaluate.add_argument('--seed', type=int, default=1, help='(default: %(default)s)')
    evaluate.add_argument(
        '-o',
        '--output',
        type=Path,
        metavar='DIR',
        help='(default: docs/report, with --quick report_quick)',
    )
    evaluate.set_defaults(run=commands.evaluate)
    return parser


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code: 2 for input that cannot be used."""
    if sys.stdout is None:  # the shell has closed it
        sys.stdout = open(os.devnull, 'w')  # noqa: SIM115 - until the process ends
    options = _parser().parse_args(arguments)
    try:
        code: int = options.run(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Who read our output wants no more of it; the interpreter must not flush into the pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (BagError, ConfigError, OSError, ValueError) as error:
        sys.stdout.flush()
        print(f'retrolidar: {error}', file=sys.stderr)
        return 2
    except ModuleNotFoundError as error:
        print(f'retrolidar: a library is missing: pip install {error.name}', file=sys.stderr)
        return 2
    return code


if __name__ == '__main__':
    sys.exit(main())
