# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor watched in a terminal: frames from a port, through the detector, onto the screen."""

from __future__ import annotations

import argparse
import math
import os
import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import TextIO

from retrolidar_ros.cli.arguments import (
    Subparsers,
    add_detector_options,
    add_port,
    detector_values,
    seconds,
)
from retrolidar_ros.cli.watch_state import Watch
from retrolidar_ros.cli.watch_view import Snapshot, fitted, line, screen
from retrolidar_ros.sensor.serial_source import PROTOCOLS, SerialSource, in_background
from retrolidar_ros.settings.interrupts import interrupted_once

_SCREEN_S, _LINE_S = 0.2, 1.0  # between two pictures, or two lines of a log


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar watch`."""
    command = subparsers.add_parser(
        'watch',
        help='show zones, bits and markers of a sensor live',
        description='Updates a terminal five times a second, else prints a line a second. End with '
        'Ctrl-C. Exit code 1 if a duration ends without any frame.',
    )
    add_port(command)
    command.add_argument(
        '--zone',
        type=int,
        metavar='N',
        help='whose bits to show (default: the one that blinks most)',
    )
    command.add_argument('--duration', type=seconds, metavar='S', help='stop after [s]')
    add_detector_options(command)
    command.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Show what a sensor sees until the duration is over, or Ctrl-C."""
    with suppress(KeyboardInterrupt), interrupted_once():
        reader = PROTOCOLS[arguments.protocol](time.monotonic_ns)
        source = SerialSource(arguments.port, arguments.baud, reader, time.monotonic_ns)
        state = Watch(source, arguments.zone, detector_values(arguments))
        interval_s = _SCREEN_S if is_screen(sys.stdout) else _LINE_S
        begin_s = time.monotonic()
        end_s = begin_s + (arguments.duration or math.inf)
        due_s = min(begin_s + interval_s, end_s)
        with in_background(source) as take_until, _display(sys.stdout) as show:
            while True:
                if (arrival := take_until(due_s)) is not None:
                    state.take(*arrival)
                now_s = time.monotonic()
                if now_s >= due_s:
                    show(state.snapshot())
                    if now_s >= end_s:
                        return 0 if state.frames else 1
                    due_s = min(now_s + interval_s, end_s)
    return 0


@contextmanager
def _display(output: TextIO) -> Iterator[Callable[[Snapshot], None]]:
    """Yield a function that shows a snapshot: on a whole terminal, else as a line."""
    if not is_screen(output):
        yield lambda snapshot: print(line(snapshot), file=output, flush=True)
        return

    def draw(snapshot: Snapshot) -> None:
        columns, rows = shutil.get_terminal_size()
        lines = fitted(screen(snapshot), columns, rows)
        # Home; each line and the end of the one before; then the rest of the screen.
        output.write('\x1b[H' + '\x1b[K\r\n'.join(lines) + '\x1b[J')
        output.flush()

    output.write('\x1b[?25l\x1b[2J')  # no cursor, no text
    try:
        yield draw
    finally:
        output.write('\r\n\x1b[?25h')
        output.flush()


def is_screen(output: TextIO) -> bool:
    """Return whether an output is a terminal that can be drawn on."""
    return output.isatty() and os.environ.get('TERM', 'dumb') != 'dumb'
