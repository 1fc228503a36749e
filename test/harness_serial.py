# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A serial source that is read in a thread, and a port that is read directly."""

import time
from pathlib import Path
from queue import Queue
from threading import Event, Thread

import serial

from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.serial_source import SerialSource
from retrolidar_ros.sensor.wire import Reader


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
