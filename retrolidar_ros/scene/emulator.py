# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor on a pseudo-terminal, with its firmware: it speaks protocol 1 about a scene."""

from __future__ import annotations

import os
import pty
import select
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from retrolidar_ros.bag import FrameWriter
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.identity import Command, Identity, encode_identity
from retrolidar_ros.sensor.wire import DELIMITER, Splitter, encode_frame, encode_packet

_BLOCK_S = 0.25  # computed ahead at a time
_MAX_BYTES = 4096
_LINGER_S = 0.25  # a hang-up discards what is still on the line
VERSION = '0.1.0'  # that of `firmware/reader`
_MAX_CHARACTERS = 15  # of a line
_END = b'\n'


class PortLink(AbstractContextManager['PortLink']):
    """A pseudo-terminal under a path of one's choice, like a serial port that comes and goes."""

    def __init__(self, path: Path) -> None:
        """Open a terminal and link `path` to it.

        FileExistsError if there is something else than a link to a pseudo-terminal, which an
        emulator that was killed may have left.
        """
        is_left_over = path.is_symlink() and Path(os.readlink(path)).parent == Path('/dev/pts')
        if path.exists() or (path.is_symlink() and not is_left_over):
            raise FileExistsError(f'{path} exists; give a path where nothing is yet')
        if not path.parent.is_dir():
            raise FileNotFoundError(f'there is no directory {path.parent} for the port {path.name}')
        self._path = path
        self._master, slave = pty.openpty()
        tty.setraw(slave)
        # Opened and closed once, the terminal says from now on whether it has a listener.
        self._port = os.ttyname(slave)
        os.close(slave)
        os.set_blocking(self._master, False)
        self._torn = False
        try:
            path.unlink(missing_ok=True)
            path.symlink_to(self._port)
        except OSError:
            os.close(self._master)
            raise

    def __exit__(self, *_: object) -> None:
        """Pull the cable."""
        self.close()

    def close(self) -> None:
        """Remove the link, unless it is another's by now, and hang up."""
        if self._path.is_symlink() and os.readlink(self._path) == self._port:
            self._path.unlink()
        os.close(self._master)

    def write(self, data: bytes) -> bool:
        """Send bytes, and a delimiter first after a torn packet; return False if nobody listens."""
        poll = select.poll()
        poll.register(self._master, select.POLLOUT)
        events = poll.poll(0)
        if not events:
            return False
        if events[0][1] & select.POLLHUP:
            self._forget_unread()
            return False
        if self._torn:
            data = DELIMITER + data
        self._torn = True
        try:
            while data:
                data = data[os.write(self._master, data) :]
        except BlockingIOError:
            return False
        self._torn = False
        return True

    def read(self) -> bytes:
        """Return what a listener has sent."""
        with suppress(OSError):  # nothing, or nobody listens
            return os.read(self._master, _MAX_BYTES)
        return b''

    def _forget_unread(self) -> None:
        """Discard what the last listener left: a real port buffers nothing for the next one."""
        slave = os.open(self._port, os.O_RDWR | os.O_NOCTTY)
        termios.tcflush(slave, termios.TCIFLUSH)
        os.close(slave)


def frames_in_real_time(
    scene: Scene, duration_s: float | None, start_ns: int, clock: Callable[[], int]
) -> Iterator[tuple[Frame, int]]:
    """Yield each frame of a scene when its exposure ends, with its true time by the clock [ns]."""
    simulation = Simulation(scene)
    for block in simulation.blocks(duration_s, max(1, round(_BLOCK_S / simulation.period_s))):
        for frame in block:
            true_s = frame.sensor_time_us * 1e-6 / (1 + scene.sensor.clock_error)
            middle_ns = start_ns + round(true_s * 1e9)
            wait_s = (middle_ns - clock()) * 1e-9 + simulation.period_s / 2
            if wait_s > 0:
                time.sleep(wait_s)
            yield frame, middle_ns


def emulate(
    scene: Scene,
    link: Path,
    duration_s: float | None = None,
    ready: Callable[[], None] = lambda: None,
    start_ns: int | None = None,
) -> tuple[int, int]:
    """Serve a scene at a port until it ends or is interrupted; return frames sent and lost.

    Frames that nobody takes are lost, and a stopped sensor sends none. The scene begins at a time
    of the monotonic clock, or when the port is there.
    """
    sent = lost = 0
    firmware = EmulatedFirmware(str(link))
    with PortLink(link) as port:
        ready()
        start_ns = time.monotonic_ns() if start_ns is None else start_ns
        with suppress(KeyboardInterrupt):
            for frame, _ in frames_in_real_time(scene, duration_s, start_ns, time.monotonic_ns):
                port.write(firmware.answer(port.read()))
                if data := firmware.encode(frame):
                    is_sent = port.write(data)
                    sent += is_sent
                    lost += not is_sent
        time.sleep(_LINGER_S)
    return sent, lost


def record(scene: Scene, path: Path, storage: str, duration_s: float) -> int:
    """Write a scene to a new bag, as if it began now; return how many frames were written."""
    start_ns = time.time_ns()
    frames = 0
    with FrameWriter(path, storage=storage) as bag:
        for block in Simulation(scene).blocks(duration_s):
            for frame in block:
                bag.write(replace(frame, stamp_ns=start_ns + frame.stamp_ns))
                frames += 1
    return frames


class EmulatedFirmware:
    """Stands between the frames of a scene and the line."""

    def __init__(self, name: str) -> None:
        """Begin to range; the serial number depends on a name."""
        self._serial = sha256(name.encode()).hexdigest()[:24]
        self._lines = Splitter(_END, _MAX_CHARACTERS)
        self._is_ranging = True
        self._is_reset = False
        self._begin_us = 0
        self._uncounted = 0  # frames of the scene before a reset, or while stopped

    def answer(self, data: bytes) -> bytes:
        """Obey the commands in what the host sends; return what to answer."""
        answers = b''
        for line in self._lines.split(data):
            with suppress(ValueError):  # noise
                command = Command((line or b'').decode('ascii', 'replace'))
                if command is not Command.IDENTIFY:
                    self._is_ranging = command is not Command.STOP
                self._is_reset |= command is Command.RESET
                answers += self._identity()
        return answers

    def encode(self, frame: Frame) -> bytes:
        """Return a frame as it goes on the line; nothing while the sensor is stopped."""
        greeting = b''
        if self._is_reset:
            self._is_reset = False
            self._begin_us, self._uncounted = frame.sensor_time_us, frame.sequence
            greeting = self._identity()
        if not self._is_ranging:
            self._uncounted += 1
            return b''
        sequence, time_us = frame.sequence - self._uncounted, frame.sensor_time_us - self._begin_us
        return greeting + encode_frame(replace(frame, sequence=sequence, sensor_time_us=time_us))

    def _identity(self) -> bytes:
        identity = Identity(VERSION, self._serial, self._is_ranging)
        return encode_packet(encode_identity(identity))
