# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The `retrolidar` command: its subcommands and its errors."""

import argparse
import io
import os
import sys

# Many threads make small matrix products slower. numpy reads this once, when it is imported.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')

from retrolidar_ros.bag import BagError
from retrolidar_ros.cli import (
    budget,
    calibrate,
    decode,
    demo,
    emulate,
    ids,
    plot,
    record,
    replay,
    watch,
)
from retrolidar_ros.cli.arguments import Parser
from retrolidar_ros.settings.files import shared_file
from retrolidar_ros.settings.printing import printable
from retrolidar_ros.settings.section import ConfigError

# Modules, by the names of their commands, with HELP, perhaps a DESCRIPTION, `add_arguments(parser)`
# and `run(arguments)`, which returns the exit code.
COMMANDS = (demo, emulate, watch, record, replay, calibrate, decode, plot, ids, budget)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    whole = Parser(
        prog='retrolidar', description='Read liquid-crystal fiducial markers with a LiDAR.'
    )
    package = shared_file('package.xml').read_text(encoding='utf-8')
    version = package.partition('<version>')[2].partition('<')[0]
    whole.add_argument(
        '--version', action='version', version=f'retrolidar {version}', help='print it and exit'
    )
    subparsers = whole.add_subparsers(required=True, metavar='COMMAND')
    for module in COMMANDS:
        name, description = module.__name__.split('.')[-1], getattr(module, 'DESCRIPTION', None)
        command = subparsers.add_parser(name, help=module.HELP, description=description)
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return whole


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit code: 2 for input that cannot be used."""
    if sys.stdout is None:  # the shell has closed it
        sys.stdout = open(os.devnull, 'w')  # noqa: SIM115 - until the process ends
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # the locale may lack some characters
            stream.reconfigure(errors='backslashreplace')
    try:
        options = parser().parse_args(arguments)
        code: int = options.run(options)
        sys.stdout.flush()
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # The reader of the output has gone; the interpreter must not flush into the pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (BagError, ConfigError, OSError, ValueError) as error:
        sys.stdout.flush()
        print(f'retrolidar: {printable(str(error))}', file=sys.stderr)
        return 2
    return code
