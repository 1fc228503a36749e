# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames from a serial port that may be absent, vanish, and come back."""

import errno
import os
import select
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Thread

import serial

from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.identity import Identity
from retrolidar_ros.sensor.st_example import StExampleReader
from retrolidar_ros.sensor.wire import FrameReader, Reader, WireCounts

RETRY_S = 0.5
_READ_TIMEOUT_S = 0.2
_WRITE_TIMEOUT_S = 1.0  # of a device that takes no bytes any longer
_MAX_BYTES = 4096

PROTOCOLS: dict[str, Callable[[Callable[[], int]], Reader]] = {
    'retrolidar': lambda _: FrameReader(),
    'st_example': StExampleReader,
}
"""Factories of readers by name; each takes a function that returns the host's time [ns]."""


def explain(error: OSError, port: str) -> str:
    """Say what is wrong with a port and what to do about it, in one line."""
    if error.errno == errno.ENOENT:
        return f'{port} does not exist; is the sensor plugged in?'
    if error.errno == errno.EACCES:
        try:
            group = Path(port).group()
        except (OSError, KeyError):  # gone by now, or of a group that has no name
            group = 'dialout'
        return (
            f'no permission to open {port}; it belongs to the group {group}: '
            f'sudo usermod -aG {group} $USER, and log in again'
        )
    if error.errno in (errno.EBUSY, errno.EAGAIN):
        return f'{port} is in use by another program'
    if error.errno in (errno.ENOTTY, errno.EISDIR):
        return f'{port} is not a serial port'
    return f'{port}: {error}'


class SerialSource:
    """Reads frames from a port, and opens it again whenever that is needed."""

    def __init__(
        self, port: str, baud: int, reader: Reader, now_ns: Callable[[], int] = time.time_ns
    ) -> None:
        """Prepare to read `port`; nothing is opened yet. `now_ns` says when frames arrive."""
        self._now_ns = now_ns
        self.port = port
        self.baud = baud
        self.reader = reader
        self.is_open = False
        self.problem = f'{port} has not been opened yet'  # empty while it is open
        self.openings = 0

    @property
    def received(self) -> WireCounts:
        """What has come so far, a copy."""
        return replace(self.reader.counts)

    @property
    def identity(self) -> Identity | None:
        """Identity of the last sensor at the port; None if it has not sent one."""
        return self.reader.commands.identity if self.reader.commands else None

    def run(
        self, take: Callable[[list[Frame], int], None], report: Callable[[str], None], stop: Event
    ) -> None:
        """Read until `stop` is set, which ends the reading within its timeout.

        `take` gets the frames of each read, and the time [ns] at which it returned. `report` gets a
        line whenever the port opens, a sensor says who it is, or there is a new reason why the port
        cannot be read; that it was lost, only if `stop` is not set soon after.
        """
        while not stop.is_set():
            try:
                with self._open() as line:
                    self.is_open = True
                    self.problem = ''
                    self.openings += 1
                    report(f'reading {self.port}')
                    self._read(line, take, report, stop)
            except OSError as error:
                lost = f'{self.port} was lost; is the sensor still plugged in?'
                was_open, self.is_open = self.is_open, False
                problem = lost if was_open else explain(error, self.port)
                is_new, self.problem = problem != self.problem, problem
                # A sensor that is emulated may end just before this program does.
                if was_open and stop.wait(RETRY_S):
                    return
                if is_new:
                    report(f'{problem}; retrying')
                if was_open:
                    continue
            finally:
                self.is_open = False
            stop.wait(RETRY_S)

    def _open(self) -> serial.Serial:
        """Open the port for this program alone; OSError if that fails."""
        try:
            # This empties the buffers: old bytes arrive at a meaningless time.
            line = serial.Serial(
                self.port, self.baud, exclusive=True, write_timeout=_WRITE_TIMEOUT_S
            )
        except (ValueError, termios.error) as error:  # a baud rate it cannot do; a port just gone
            raise OSError(*error.args) from error
        except serial.SerialException as error:
            # Of what is no terminal pyserial tells in its text only what the system has said.
            if isinstance(error.__context__, termios.error):
                raise OSError(*error.__context__.args) from error
            raise
        self.reader.restart()  # ends the packet in which the port was lost
        return line

    def _read(
        self,
        line: serial.Serial,
        take: Callable[[list[Frame], int], None],
        report: Callable[[str], None],
        stop: Event,
    ) -> None:
        # Not line.read: it takes the first byte by itself, so a frame would cost twice the calls.
        waiting = select.poll()
        waiting.register(line.fileno(), select.POLLIN)
        reported: Identity | None = None
        while not stop.is_set():
            data = b''
            if waiting.poll(1e3 * _READ_TIMEOUT_S):
                data = os.read(line.fileno(), _MAX_BYTES)
                if not data:
                    raise OSError(errno.EIO, 'the port has nothing to read')
            arrival_ns = self._now_ns()
            self.reader.counts.bytes += len(data)
            if frames := self.reader.feed(data):
                take(frames, arrival_ns)
            if (who := self.identity) is not None and who is not reported:
                if reported is None or who.text() != reported.text():
                    report(f'{self.port}: {who.text()}')
                reported = who
            if request := self.reader.request():
                line.write(request)


@contextmanager
def in_background(
    source: SerialSource, report: Callable[[str], None] = lambda _: None
) -> Iterator[Callable[[float], tuple[list[Frame], int] | None]]:
    """Read a source in a thread until the block ends; `report` is as for `SerialSource.run`.

    Yields a function that returns what arrived first, frames and time [ns]; None if nothing arrives
    until a time of `time.monotonic`.
    """
    arrived: SimpleQueue[tuple[list[Frame], int] | Exception] = SimpleQueue()
    stop = Event()

    def read() -> None:
        try:
            source.run(lambda *arrival: arrived.put(arrival), report, stop)
        except Exception as error:  # it is raised where the frames are taken
            arrived.put(error)

    def take_until(time_s: float) -> tuple[list[Frame], int] | None:
        with suppress(Empty):
            arrival = arrived.get(timeout=max(time_s - time.monotonic(), 0.0))
            if isinstance(arrival, Exception):
                raise arrival
            return arrival
        return None

    thread = Thread(target=read, daemon=True)
    thread.start()
    try:
        yield take_until
    finally:
        stop.set()
        thread.join()
