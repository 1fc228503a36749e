# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the firmware of an emulated sensor does: it numbers frames, and obeys commands."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from hashlib import sha256

from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.sensor.identity import Command, Identity, encode_identity
from retrolidar_ros.sensor.wire import Splitter, encode_frame, encode_packet

VERSION = '0.1.0'  # that of `firmware/reader`
_MAX_CHARACTERS = 15  # of a line
_END = b'\n'


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
