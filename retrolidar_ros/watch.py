# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor watched in a terminal: frames from a port, through the detector, onto the screen."""

from __future__ import annotations

import math
import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import TextIO

from retrolidar_ros.frame import Frame
from retrolidar_ros.protocols import PROTOCOLS
from retrolidar_ros.serial_source import SerialSource
from retrolidar_ros.watch_state import Watch
from retrolidar_ros.watch_view import Snapshot, Symbols, fitted, line, screen

_SCREEN_S, _LINE_S = 0.2, 1.0  # between two pictures, or two lines of a log


@contextmanager
def _display(output: TextIO) -> Iterator[Callable[[Snapshot], None]]:
    """Give what shows a snapshot: on the whole screen of a terminal, else as a line of a log."""
    if not is_screen(output):
        yield lambda snapshot: print(line(snapshot), file=output, flush=True)
        return
    symbols = Symbols.of(output.encoding)

    def draw(snapshot: Snapshot) -> None:
        columns, rows = shutil.get_terminal_size()
        lines = fitted(screen(snapshot, symbols), columns, rows)
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
    """Tell whether an output is a terminal that can be drawn on."""
    return output.isatty() and os.environ.get('TERM', 'dumb') != 'dumb'


def watch(
    port: str,
    output: TextIO,
    *,
    baud: int,
    protocol: str,
    zone: int | None,
    bit_period_s: float,
    duration_s: float | None,
) -> int:
    """Show what a sensor sees until the duration is over, or KeyboardInterrupt.

    Parameters
    ----------
    port : str
        Its device.
    output : text stream
        Where to show it: in pictures on a terminal, else in lines.
    baud : int
        Speed of the line [bit/s].
    protocol : str
        One of `PROTOCOLS`.
    zone : int or None
        Whose bits to show; None = those of the zone that blinks most.
    bit_period_s : float
        How long a marker holds a bit [s].
    duration_s : float or None
        When to end [s]; None = never.

    Returns
    -------
    int
        How many frames came.

    Raises
    ------
    ValueError
        If the sensor has no such zone.
    """
    arrived: SimpleQueue[tuple[list[Frame], int, str] | Exception] = SimpleQueue()
    stop = Event()
    source = SerialSource(port, baud, PROTOCOLS[protocol](time.monotonic_ns), time.monotonic_ns)

    def pass_on(frames: list[Frame], arrival_ns: int) -> None:
        arrived.put((frames, arrival_ns, source.reader.notice()))

    def read() -> None:
        try:
            source.run(pass_on, lambda _: None, stop)
        except Exception as error:  # it must not end unheard
            arrived.put(error)

    state = Watch(source, zone, bit_period_s)
    thread = Thread(target=read, daemon=True)
    thread.start()
    interval_s = _SCREEN_S if is_screen(output) else _LINE_S
    begin_s = time.monotonic()
    end_s = math.inf if duration_s is None else begin_s + duration_s
    due_s = min(begin_s + interval_s, end_s)
    try:
        with _display(output) as show:
            while True:
                with suppress(Empty):
                    news = arrived.get(timeout=max(due_s - time.monotonic(), 0.0))
                    if isinstance(news, Exception):
                        raise news
                    state.take(*news)
                now_s = time.monotonic()
                if now_s >= due_s:
                    show(state.snapshot())
                    if now_s >= end_s:
                        return state.frames
                    due_s = min(now_s + interval_s, end_s)
    finally:
        stop.set()
        thread.join()
