# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Identity of a sensor, and commands to it: protocol version 1."""

from collections import deque
from enum import Enum
from struct import Struct
from threading import Condition
from typing import NamedTuple

KIND_IDENTITY = 2

_LAYOUT = Struct('<B3B?12s')  # kind, version, whether it ranges, serial number


class Command(Enum):
    """A command to a sensor, sent as a line of text."""

    IDENTIFY = 'identify'
    START = 'start'
    STOP = 'stop'
    RESET = 'reset'

    def line(self) -> bytes:
        """Return what is sent; noise before it is a line of its own."""
        return f'\n{self.value}\n'.encode()


class Identity(NamedTuple):
    """The answer of a sensor to each command, also sent when it starts."""

    version: str  # of its firmware
    serial: str  # its serial number, in 24 hexadecimal digits
    is_ranging: bool

    def text(self) -> str:
        """Return version and serial number, for people."""
        return f'firmware {self.version}, serial number {self.serial}'


def encode_identity(identity: Identity) -> bytes:
    """Return the content of an identity's packet, without its checksum."""
    version = (int(part) for part in identity.version.split('.'))
    serial = bytes.fromhex(identity.serial)
    return _LAYOUT.pack(KIND_IDENTITY, *version, identity.is_ranging, serial)


def decode_identity(content: bytes) -> Identity:
    """Return the identity in a packet's content; ValueError for a wrong length."""
    if len(content) != _LAYOUT.size:
        raise ValueError(f'an identity of {len(content)} bytes, not {_LAYOUT.size}')
    _, major, minor, patch, is_ranging, serial = _LAYOUT.unpack(content)
    return Identity(f'{major}.{minor}.{patch}', serial.hex(), is_ranging)


class Commands:
    """Commands to a sensor from one thread, and its answers in another.

    A sensor ranges unless it was stopped here: one that was reset or plugged in meanwhile gets the
    command again, once. One whose firmware knows no commands never answers.
    """

    def __init__(self) -> None:
        self.identity: Identity | None = None  # the last answer of the sensor at the port
        self._answers = 0
        self._wants_ranging = True
        self._is_reminded = False
        self._unsent: deque[Command] = deque()
        self._answered = Condition()

    def restart(self) -> None:
        """Request the identity: it may be another sensor."""
        self.identity, self._is_reminded = None, False
        self._unsent.clear()
        self._unsent.append(Command.IDENTIFY)

    def request(self) -> bytes:
        """Return what is to be sent now."""
        lines = b''
        while self._unsent:
            lines += self._unsent.popleft().line()
        return lines

    def take(self, identity: Identity) -> None:
        """Take an answer."""
        with self._answered:
            self.identity = identity
            self._answers += 1
            if identity.is_ranging == self._wants_ranging:
                self._is_reminded = False
            elif not self._is_reminded:
                self._is_reminded = True
                self._unsent.append(Command.START if self._wants_ranging else Command.STOP)
            self._answered.notify_all()

    def ask(self, command: Command, timeout_s: float) -> bool:
        """Send a command; return whether its effect came, TimeoutError without any answer."""
        with self._answered:
            wanted, self._wants_ranging = self._wants_ranging, command is not Command.STOP
            self._is_reminded = True
            before = self._answers
            self._unsent.append(command)
            self._answered.wait_for(lambda: self._answers > before and self._is_obeyed(), timeout_s)
            if self._answers == before:
                self._wants_ranging = wanted
                raise TimeoutError(f'no answer to {command.value}')
            return self._is_obeyed()

    def _is_obeyed(self) -> bool:
        return self.identity is not None and self.identity.is_ranging == self._wants_ranging
