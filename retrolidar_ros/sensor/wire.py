# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bytes on the serial line to and from frames: protocol version 1.

A packet is a header, the zones in the sensor's own order, and a checksum, all little-endian. It is
COBS-encoded (Cheshire and Baker 1999), so that 0x00 only ends packets. Zone 0 of the sensor sees
the scene's top right, so columns are turned round.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from binascii import crc_hqx
from collections.abc import Iterator
from dataclasses import dataclass
from struct import Struct

import numpy as np

from retrolidar_ros.core import ffi, lib
from retrolidar_ros.sensor.frame import GRIDS, Frame
from retrolidar_ros.sensor.identity import KIND_IDENTITY, Commands, decode_identity
from retrolidar_ros.sensor.model import Status

KIND_FRAME = 1
DELIMITER = b'\0'
MAX_PACKET_BYTES = 4096  # a frame of 8x8 zones has 724; longer kinds may come one day

_HEADER = Struct('<BIQBB')  # kind, sequence, sensor time, rows, columns
_ZONE = np.dtype([('distance', '<i2'), ('signal', '<u4'), ('ambient', '<u4'), ('status', 'u1')])
_CRC_BYTES = 2
_DISTANCE_PER_M = 4000.0  # quarter millimetres
_SIGNAL_PER_KCPS = 2048.0


def cobs_encode(data: bytes) -> bytes:
    """Encode bytes so that none of them is zero, at the cost of one byte in 254."""
    encoded = bytearray()
    for chunk in data.split(DELIMITER):
        full, rest = divmod(len(chunk), 254)
        for block in range(full):
            encoded += b'\xff' + chunk[block * 254 : (block + 1) * 254]
        encoded.append(rest + 1)
        encoded += chunk[len(chunk) - rest :]
    if full and not rest:
        encoded.pop()  # a full block stands for no zero, so at the end it needs no successor
    return bytes(encoded)


def cobs_decode(encoded: bytes) -> bytes:
    """Undo `cobs_encode`; ValueError for a zero, or a length byte that points beyond the end."""
    data = ffi.new('uint8_t[]', len(encoded) + 1)
    written = lib.rl_cobs_decode(encoded, len(encoded), data)
    if written < 0:
        raise ValueError(
            f'no COBS: byte {encoded[-1 - written]} at {-1 - written} of {len(encoded)}'
        )
    return bytes(ffi.buffer(data, written))


def crc16(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE of bytes (0x29B1 for the digits 1 to 9)."""
    return crc_hqx(data, 0xFFFF)


def encode_packet(content: bytes) -> bytes:
    """Return a packet of any kind as it goes on the line: checksum, COBS and delimiter added."""
    return cobs_encode(content + crc16(content).to_bytes(2, 'little')) + DELIMITER


def encode_frame(frame: Frame) -> bytes:
    """Return a frame as it goes on the line; values beyond the wire's range are clipped.

    ValueError if an array has not one value a zone, a signal or ambient light is not finite, a
    distance is NaN where the status is not 255, or a counter does not fit.
    """
    grid = frame.grid
    zones = np.zeros(grid.zones, dtype=_ZONE)
    frame.check()
    missing = np.isnan(frame.distance)
    if (frame.status[missing] != Status.NO_TARGET).any():
        raise ValueError('a distance is NaN where the status is not 255, no target')
    distance_m = np.where(missing, 0.0, frame.distance.astype(np.float64))
    quarter_mm = np.rint(distance_m * _DISTANCE_PER_M)
    zones['distance'] = np.clip(quarter_mm, -(2**15), 2**15 - 1)
    for name, kcps in (('signal', frame.signal), ('ambient', frame.ambient)):
        if not np.isfinite(kcps).all():
            raise ValueError(f'{name} {kcps[~np.isfinite(kcps)][0]} is not finite')
        zones[name] = np.clip(np.rint(kcps.astype(np.float64) * _SIGNAL_PER_KCPS), 0, 2**32 - 1)
    zones['status'] = frame.status
    if not (0 <= frame.sequence < 2**32 and 0 <= frame.sensor_time_us < 2**64):
        raise ValueError(
            f'sequence {frame.sequence} or sensor time {frame.sensor_time_us} µs does not fit'
        )
    header = _HEADER.pack(KIND_FRAME, frame.sequence, frame.sensor_time_us, grid.rows, grid.columns)
    sensor_order = zones.reshape(grid.rows, grid.columns)[:, ::-1]
    return encode_packet(header + sensor_order.tobytes())


def _decode_frame(content: bytes) -> Frame:
    """Return the frame in a packet's content, checksum removed; ValueError for a wrong shape."""
    if len(content) < _HEADER.size:
        raise ValueError(f'a frame of {len(content)} bytes has no whole header')
    _, sequence, time_us, rows, columns = _HEADER.unpack_from(content)
    expected = _HEADER.size + rows * columns * _ZONE.itemsize
    grid = GRIDS.get((rows, columns))
    if grid is None or len(content) != expected:
        raise ValueError(f'a frame of {rows}x{columns} zones in {len(content)} bytes')
    values = np.empty((3, rows * columns), dtype=np.float32)
    status = np.empty(rows * columns, dtype=np.uint8)
    lib.rl_wire_zones(
        ffi.from_buffer('uint8_t[]', content) + _HEADER.size,
        rows,
        *(ffi.from_buffer('float[]', one) for one in values),
        ffi.from_buffer('uint8_t[]', status),
    )
    distance, signal, ambient = values
    return Frame(time_us * 1000, sequence, time_us, grid, distance, signal, ambient, status)


@dataclass
class WireCounts:
    """What has come so far: packets by outcome; of text, frames and lines."""

    bytes: int = 0
    frames: int = 0
    bad_framing: int = 0  # not valid COBS; a line that is no text
    bad_crc: int = 0
    bad_shape: int = 0  # a packet of an impossible shape or length
    unknown_kind: int = 0
    overlong: int = 0  # more than `MAX_PACKET_BYTES`, or than a line can have, without a delimiter
    withheld: int = 0  # frames without signal, which the sensor is requested to switch on

    @property
    def damaged(self) -> int:
        """Packets lost to damage on the line."""
        return self.bad_framing + self.bad_crc + self.bad_shape + self.overlong

    @property
    def unread(self) -> int:
        """Packets without a frame for any reason."""
        return self.damaged + self.unknown_kind

    def silence(self, then: WireCounts) -> str:
        """Return why no frames have come since `then`."""
        if self.withheld > then.withheld:
            return (
                'frames come without signal and ambient light, although the key s, which switches '
                'them on, was sent: press it in a terminal, or restart the board'
            )
        if self.unread > then.unread:
            return 'no frames come, but damaged packets: another baud rate or protocol?'
        if count := self.bytes - then.bytes:
            return f'no frames come, but {count} bytes: another baud rate or protocol?'
        return 'nothing comes: is the sensor started, and the baud rate right?'


class Splitter:
    """Cuts a stream of bytes at a delimiter, in bounded memory."""

    def __init__(self, delimiter: bytes, longest: int) -> None:
        """Start between pieces, none of which is longer than `longest` bytes."""
        self._delimiter = delimiter
        self._longest = longest
        self._begun = b''  # the beginning of a piece
        self._is_discarding = False  # the rest of a piece that is too long

    def split(self, data: bytes) -> Iterator[bytes | None]:
        """Take the next bytes; yield the pieces they end, and None for one that is too long."""
        *pieces, self._begun = (self._begun + data).split(self._delimiter)
        for piece in pieces:
            if not self._is_discarding:
                yield piece if len(piece) <= self._longest else None
            self._is_discarding = False
        if len(self._begun) > self._longest:
            if not self._is_discarding:
                yield None
            self._begun, self._is_discarding = b'', True


class Reader(ABC):
    """Finds frames in a stream of bytes; accepts any bytes, in bounded memory."""

    commands: Commands | None = None  # commands and answers, if the protocol has them

    def __init__(self, pieces: Splitter) -> None:
        """Start anywhere in the stream, which is cut into pieces."""
        self.counts = WireCounts()
        self._pieces = pieces

    def feed(self, data: bytes) -> list[Frame]:
        """Take the next bytes of the stream; return the frames they complete, oldest first."""
        frames = []
        for piece in self._pieces.split(data):
            self.counts.overlong += piece is None
            if (frame := self._read(piece)) is not None:
                self.counts.frames += 1
                frames.append(frame)
        return frames

    @abstractmethod
    def restart(self) -> None:
        """Forget a frame that was cut off: the next bytes do not continue it."""

    @abstractmethod
    def request(self) -> bytes:
        """Return bytes to send to the sensor now; mostly none."""

    @abstractmethod
    def _read(self, piece: bytes | None) -> Frame | None:
        """Return the frame that a piece completes, if it does; None was too long."""


class FrameReader(Reader):
    """Finds the frames of protocol version 1.

    Damage costs the packet it is in, and the next as well if it hit the delimiter between them.
    What stands before the first delimiter may be the rest of a packet, and then is no damage.
    """

    def __init__(self) -> None:
        super().__init__(Splitter(DELIMITER, MAX_PACKET_BYTES))
        self.commands: Commands = Commands()
        self._is_in_step = False  # whether the next packet is known to come from its beginning

    def restart(self) -> None:
        """Forget a frame that was cut off, and the identity: the next bytes do not continue it."""
        self.feed(DELIMITER)
        self.commands.restart()
        self._is_in_step = False

    def request(self) -> bytes:
        """Return the commands to send to the sensor now; mostly none."""
        return self.commands.request()

    def _read(self, packet: bytes | None) -> Frame | None:
        """Return the frame of one packet, or count why there is none."""
        was_in_step, self._is_in_step = self._is_in_step, True
        if not packet:
            return None
        try:
            data = cobs_decode(packet)
        except ValueError:
            self.counts.bad_framing += was_in_step
            return None
        content, checksum = data[:-_CRC_BYTES], data[-_CRC_BYTES:]
        if not content or crc16(content) != int.from_bytes(checksum, 'little'):
            self.counts.bad_crc += was_in_step
            return None
        if content[0] not in (KIND_FRAME, KIND_IDENTITY):
            self.counts.unknown_kind += 1
            return None
        try:
            if content[0] == KIND_IDENTITY:
                self.commands.take(decode_identity(content))
                return None
            return _decode_frame(content)
        except ValueError:
            self.counts.bad_shape += 1
            return None
