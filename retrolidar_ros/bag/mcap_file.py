# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages from an MCAP file, up to its damage.

The file is scanned without its index: a power cut leaves none, and a last chunk that is cut off
and may hold a minute of frames. The `mcap` library yields nothing of such a chunk.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from heapq import heappop, heappush
from itertools import count
from pathlib import Path
from struct import Struct
from typing import BinaryIO
from zlib import crc32

from retrolidar_ros.bag.compression import decompress
from retrolidar_ros.bag.errors import DamageError
from retrolidar_ros.bag.serialized import FRAME_TYPE

_MCAP_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_RECORD = Struct('<BQ')  # opcode, length of the content
_MESSAGE_HEAD = Struct('<HIQQ')  # channel, sequence, log time, publish time
_CHUNK_HEAD = Struct('<QQQII')  # first and last log time, size, CRC-32, length of compression
_UINT32 = Struct('<I')
_IDS = Struct('<HH')  # channel and schema
_MOST_HELD = 2**29
_BROKEN = (DamageError, OSError, struct.error, UnicodeDecodeError)


def read_mcap(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from an MCAP file, oldest first."""
    with file.open('rb') as stream:
        yield from _McapFile(stream, file.stat().st_size, topic, types).messages()


class _McapFile:
    """An MCAP file (version 0, see mcap.dev/spec), read by its records, without its index."""

    def __init__(self, stream: BinaryIO, size: int, topic: str, types: dict[str, str]) -> None:
        self._stream = stream
        self._size = size
        self._topic = topic
        self._types = types
        self._schemas: dict[int, str] = {}
        self._wanted: dict[int, bool] = {}  # by channel
        self._pieces: list[tuple[int, int, int, bool]] = []  # first log time, start, end, chunk?

    def messages(self) -> Iterator[bytes]:
        """Yield the messages of the topic by log time; DamageError after the last good one."""
        damage = None
        try:
            self._scan()
        except _BROKEN as error:
            damage = DamageError(_reason(error))
        pending: list[tuple[int, int, bytes]] = []  # a heap, of one time in order of the file
        order, held = count(), 0
        for first_time, start, end, is_chunk in sorted(self._pieces):
            while pending and pending[0][0] < first_time:
                data = heappop(pending)[-1]
                held -= len(data)
                yield data
            try:
                for time, data in self._piece(start, end, is_chunk):
                    if time < first_time:
                        raise DamageError('a message is older than its chunk')
                    heappush(pending, (time, next(order), data))
                    held += len(data)
                if held > _MOST_HELD:
                    raise DamageError(f'more than {_MOST_HELD} bytes of messages are out of order')
            except _BROKEN as error:
                damage = DamageError(f'the record at byte {start}: {_reason(error)}')
                break
        while pending:
            yield heappop(pending)[-1]
        if damage is not None:
            raise damage

    def _scan(self) -> None:
        """Find chunks, messages outside of chunks, and channels."""
        if self._read(0, len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise DamageError('not an MCAP file')
        position = len(_MCAP_MAGIC)
        opcode = None
        while opcode != _FOOTER:
            opcode, length = _RECORD.unpack(self._read(position, _RECORD.size))
            content = position + _RECORD.size
            end = content + length
            if opcode == _CHUNK:  # of one that is cut off, the first messages are good
                first_time = _CHUNK_HEAD.unpack(self._read(content, _CHUNK_HEAD.size))[0]
                self._pieces.append((first_time, content, min(end, self._size), True))
            if end > self._size or opcode == 0:
                raise DamageError(f'no whole record at byte {position}')
            if opcode == _MESSAGE:
                time = _MESSAGE_HEAD.unpack(self._read(content, _MESSAGE_HEAD.size))[2]
                self._pieces.append((time, position, end, False))
            elif opcode in (_SCHEMA, _CHANNEL):
                self._define(opcode, self._read(content, length))
            position = end
        if self._read(position, len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise DamageError(f'no end mark at byte {position}')

    def _piece(self, start: int, end: int, is_chunk: bool) -> Iterator[tuple[int, bytes]]:
        """Yield (log time, data) of the topic's messages in a chunk or in a record."""
        data = self._read(start, end - start)
        if not is_chunk:
            yield from self._records(data)
            return
        _, _, size, checksum, length = _CHUNK_HEAD.unpack_from(data)
        compression = data[_CHUNK_HEAD.size :][:length].decode()
        records = decompress(compression, data[_CHUNK_HEAD.size + length + 8 :])
        if len(records) == size and checksum not in (0, crc32(records)):
            raise DamageError('wrong checksum')
        yield from self._records(records)
        if len(records) != size:
            raise DamageError(f'{len(records)} of {size} bytes')

    def _records(self, records: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield (log time, data) of the topic's messages in a run of records."""
        position = 0
        while position < len(records):
            opcode, length = _RECORD.unpack_from(records, position)
            content = position + _RECORD.size
            position = content + length
            if position > len(records) or opcode == 0:
                raise DamageError('a record inside is cut off')
            if opcode == _MESSAGE:
                channel, _, time, _ = _MESSAGE_HEAD.unpack_from(records, content)
                if channel not in self._wanted:
                    raise DamageError(f'channel {channel} is not defined')
                if self._wanted[channel]:
                    yield time, records[content + _MESSAGE_HEAD.size : position]
            elif opcode in (_SCHEMA, _CHANNEL):
                self._define(opcode, records[content:position])

    def _define(self, opcode: int, content: bytes) -> None:
        """Store a schema or a channel."""
        if opcode == _SCHEMA:
            self._schemas[_IDS.unpack_from(content)[0]] = _text(content, 2)
        else:
            channel, schema = _IDS.unpack_from(content)
            name, type_name = _text(content, _IDS.size), self._schemas.get(schema, 'unknown')
            self._types[name] = type_name
            self._wanted[channel] = name == self._topic and type_name == FRAME_TYPE

    def _read(self, position: int, length: int) -> bytes:
        """Return bytes of the file; DamageError if it ends before."""
        self._stream.seek(position)
        data = self._stream.read(length)
        if len(data) < length:
            raise DamageError(f'the file ends at byte {self._size}, where a record goes on')
        return data


def _reason(error: Exception) -> str:
    """Return what is wrong with a record."""
    return str(error) if isinstance(error, (DamageError, OSError)) else 'damaged'


def _text(data: bytes, start: int) -> str:
    """Return the string at a position in a record."""
    (length,) = _UINT32.unpack_from(data, start)
    return data[start + _UINT32.size :][:length].decode()
