# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The protocols that a sensor on a serial line may speak."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.identity import Commands
from retrolidar_ros.sensor.st_example import StExampleReader
from retrolidar_ros.sensor.wire import FrameReader, WireCounts


class Reader(Protocol):
    """Finds frames in a stream of bytes; accepts any bytes."""

    @property
    def counts(self) -> WireCounts:
        """Frames and errors so far."""

    @property
    def commands(self) -> Commands | None:
        """Commands and answers; None if the protocol has none."""

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes of the stream; return the frames they complete, oldest first."""

    def restart(self) -> None:
        """Forget a frame that was cut off: the next bytes do not continue it."""

    def request(self) -> bytes:
        """Return bytes to send to the sensor now; mostly none."""


PROTOCOLS: dict[str, Callable[[Callable[[], int]], Reader]] = {
    'retrolidar': lambda _: FrameReader(),
    'st_example': StExampleReader,
}
"""Factories of readers by name; each takes a function that returns the host's time [ns]."""
