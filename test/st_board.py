# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A serial line: ST's `53L8A1_SimpleRanging` that prints on it, and a source that reads it.

The board is written from what the example does (X-CUBE-TOF1, `app_tof.c`, `vl53l8cx.c`), not from
its reader.
"""

import os
import pty
import random
import select
import time
import tty
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import Queue
from threading import Event, Thread
from typing import NamedTuple

import numpy as np
import serial

from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.model import Status
from retrolidar_ros.sensor.serial_source import SerialSource
from retrolidar_ros.sensor.wire import Reader

DASHES = ' -----------------'
BLANKS = '|                 '
PRINTED = {5: 0, 9: 0, 0: 255}
"""Statuses for which the example prints another number."""


class Zone(NamedTuple):
    """What the sensor has of a zone with a target."""

    distance_mm: int
    status: int = 5
    signal_kcps: int = 100
    ambient_kcps: int = 3


Zones = Sequence[Zone | None]
"""In the sensor's order, 16 or 64: the first is at the scene's top right. None has no target."""


def text_of(zones: Zones, light: bool = True, line_end: str = '\n') -> bytes:
    """Return what the example prints of one frame."""
    side = {16: 4, 64: 8}[len(zones)]
    lines = [
        '\x1b[2H53L8A1 Simple Ranging demo application',
        '--------------------------------------',
        '',
        'Use the following keys to control application',
        " 'r' : change resolution",
        " 's' : enable signal and ambient",
        " 'c' : clear screen",
        '',
        'Cell Format :',
        '',
        f' \x1b[38;5;10m{"Distance [mm]":>20}\x1b[0m : {"Status":>20}',
    ]
    if light:
        lines.append(f' {"Signal [kcps/spad]":>20} : {"Ambient [kcps/spad]":>20}')
    lines += ['', '']
    nothing = f'| {"X":>5}  :  {"X":>5} '
    for first in range(0, side * side, side):
        ranging = rates = ''
        for zone in zones[first : first + side][::-1]:
            if zone:
                status = PRINTED.get(zone.status, zone.status)
                ranging += f'| \x1b[38;5;10m{zone.distance_mm:5d}\x1b[0m  :  {status:5d} '
                rates += f'| {zone.signal_kcps:5d}  :  {zone.ambient_kcps:5d} '
            else:
                ranging, rates = ranging + nothing, rates + nothing
        lines += [DASHES * side, BLANKS * side + '|', ranging + '|']
        if light:
            lines.append(rates + '|')
    lines.append(DASHES * side)
    return ''.join(line + line_end for line in lines).encode('ascii')


class Board:
    """A board at a pseudo-terminal, whose loop is called turn by turn."""

    def __init__(self, zones: Zones) -> None:
        self.zones = zones
        self.light = False
        self.keys = b''
        """The keys it has heeded."""
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)

    def __enter__(self) -> 'Board':
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._master)
        os.close(self._slave)

    def print_frame(self) -> None:
        self._send(text_of(self.zones, self.light))

    def _send(self, data: bytes) -> None:
        """Send bytes; a line does not wait for its reader, so they may be lost."""
        with suppress(BlockingIOError):
            while data:
                data = data[os.write(self._master, data) :]

    def heed_key(self, timeout_s: float) -> bool:
        """Do what a key says if one comes in time; return whether one came."""
        ready, _, _ = select.select([self._master], [], [], timeout_s)
        if not ready:
            return False
        key = os.read(self._master, 1)
        self.keys += key
        if key == b's':
            self.light = not self.light
            self._send(b'\x1b[2J')
        return True

    @contextmanager
    def printing(self) -> Iterator[None]:
        """Print frames and heed keys, as the example does for ever, while the block lasts."""
        stop = Event()

        def run() -> None:
            while not stop.wait(0.05):
                self.print_frame()
                self.heed_key(0)

        thread = Thread(target=run)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


def make_zones(side: int = 4, seed: int = 1) -> list[Zone | None]:
    """Return zones that all differ, some without a target."""
    rng = random.Random(seed)
    zones: list[Zone | None] = [
        Zone(rng.randrange(1, 4000), rng.choice((5, 6, 10, 13)), rng.randrange(3000), index)
        for index in range(side * side)
    ]
    for index in rng.sample(range(side * side), 3):
        zones[index] = None
    return zones


def check_zones(frame: Frame, zones: Zones) -> None:
    """Hold a frame against zones in the sensor's order."""
    side = frame.grid.columns
    printed = np.array([zone or (np.nan, Status.NO_TARGET, 0, 0) for zone in zones])
    # It begins at the right.
    distance_mm, *others = printed.reshape(side, side, 4)[:, ::-1].reshape(-1, 4).T
    np.testing.assert_array_equal(frame.distance, np.float32(distance_mm / 1000))
    np.testing.assert_array_equal([frame.status, frame.signal, frame.ambient], others)


class Reading:
    """A source that runs in a thread, and queues of what it reports and takes."""

    def __init__(self, port: Path, baud: int, reader: Reader) -> None:
        self.source = SerialSource(str(port), baud, reader)
        self.reports: Queue[str] = Queue()
        self.frames: Queue[tuple[Frame, int]] = Queue()
        self.stop = Event()
        self.errors: list[BaseException] = []
        self.thread = Thread(target=self._run)
        self.thread.start()

    def _run(self) -> None:
        try:
            self.source.run(self._take, self.reports.put, self.stop)
        except BaseException as error:
            self.errors.append(error)

    def _take(self, frames: list[Frame], arrival_ns: int) -> None:
        for frame in frames:
            self.frames.put((frame, arrival_ns))

    def report(self) -> str:
        return self.reports.get(timeout=10)

    def frame(self) -> Frame:
        return self.frames.get(timeout=10)[0]

    def sequences(self, count: int) -> list[int]:
        return [self.frame().sequence for _ in range(count)]

    def end(self) -> float:
        """Stop the source; return how long that took [s]."""
        begin_s = time.monotonic()
        self.stop.set()
        self.thread.join(10)
        assert not self.thread.is_alive()
        assert not self.errors
        return time.monotonic() - begin_s


def listen(port: Path) -> serial.Serial:
    return serial.Serial(str(port), 115200, timeout=5, exclusive=True)
