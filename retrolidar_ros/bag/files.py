# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages from the MCAP and SQLite files of rosbag2, as far as they are good.

Written here and not taken from a library, so that a recording that a power cut has damaged is
saved. An MCAP file is scanned, whatever its index says: a power cut leaves none, and it leaves a
last chunk that is cut off and may hold a minute of frames, of which the `mcap` library yields
nothing. A cut SQLite file is read to its last whole page.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
from heapq import heappop, heappush
from itertools import count
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory
from typing import BinaryIO
from zlib import crc32

from retrolidar_ros.bag.messages import FRAME_TYPE, DamageError, decompress

_MCAP_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_RECORD = Struct('<BQ')  # opcode, length of the content
_MESSAGE_HEAD = Struct('<HIQQ')  # channel, sequence, log time, publish time
_CHUNK_HEAD = Struct('<QQQII')  # first and last log time, size, CRC-32, length of compression
_UINT32 = Struct('<I')
_IDS = Struct('<HH')  # channel and schema
_MAX_HELD = 2**29
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
                if held > _MAX_HELD:
                    raise DamageError(f'more than {_MAX_HELD} bytes of messages are out of order')
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


_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEADER = Struct('>16sH10xI')  # magic, page size, pages
_ROWS = (
    "SELECT COALESCE(CAST(data AS BLOB), x''), timestamp, id FROM messages {}"
    ' WHERE topic_id IN (SELECT id FROM topics WHERE name = ? AND type = ?) {}'
)
_TABLES = "SELECT name, type, sql FROM sqlite_master WHERE name IN ('messages', 'topics')"
_INTERRUPTED = 'interrupted'
_STEPS = 100_000  # of SQLite's machine, a millisecond or so
_ROWS_BY_TIME = _ROWS.format('', 'ORDER BY timestamp, id')
_ROWS_AFTER = _ROWS.format('NOT INDEXED', 'AND (timestamp, id) > (?, ?) ORDER BY id')


def read_sqlite(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from an SQLite file, oldest first."""
    with file.open('rb') as stream:
        header = stream.read(_SQLITE_HEADER.size).ljust(_SQLITE_HEADER.size, b'\0')
    magic, page, pages = _SQLITE_HEADER.unpack(header)
    if magic != _SQLITE_MAGIC:
        raise DamageError('not an SQLite file')
    page = 2**16 if page == 1 else page
    size = file.stat().st_size
    # What a recorder that was killed has not yet put into the file, or not yet taken out of it.
    logs = [file.with_name(f'{file.name}{end}') for end in ('-wal', '-journal')]
    logs = [log for log in logs if log.is_file() and log.stat().st_size]
    is_short = size < page * pages and not logs
    short = f'the file ends at byte {size} of {page * pages}' if is_short else ''
    try:
        if logs:
            with TemporaryDirectory() as directory:  # SQLite repairs the copy, and leaves the bag
                for part in (file, *logs):
                    shutil.copy(part, directory)
                yield from _read_database(Path(directory, file.name), topic, types, mode='rw')
        elif short and size % page:
            with TemporaryDirectory() as directory:
                whole = Path(shutil.copy(file, directory))
                os.truncate(whole, size - size % page)  # else SQLite reads zeros after the end
                yield from _read_database(whole, topic, types)
        else:
            yield from _read_database(file, topic, types)
    except sqlite3.Error as error:
        raise DamageError(short or str(error)) from error
    if short:
        raise DamageError(short)


def _read_database(
    file: Path, topic: str, types: dict[str, str], mode: str = 'ro&immutable=1'
) -> Iterator[bytes]:
    """Yield the messages of a topic from a database that may have lost its end."""
    with closing(
        sqlite3.connect(f'{file.absolute().as_uri()}?mode={mode}', uri=True)
    ) as connection:
        # Where Python runs, so that Ctrl-C ends a query.
        connection.set_progress_handler(lambda: 0, _STEPS)
        try:
            yield from _messages(connection, topic, types)
        except sqlite3.OperationalError as error:
            if str(error) == _INTERRUPTED:
                raise KeyboardInterrupt from None
            raise


def _messages(connection: sqlite3.Connection, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    last = [-(2**63), 0]  # timestamp and id
    connection.execute('PRAGMA writable_schema = ON')  # accepts a file without its end
    for name, kind, text in connection.execute(_TABLES):
        if kind != 'table' or re.search(r'\bAS\b', str(text), re.IGNORECASE):
            raise DamageError(f'{name} is computed, and no table that a recorder has written')
    for name, type_name in connection.execute('SELECT name, type FROM topics'):
        types[str(name)] = str(type_name)
    try:
        for data, *key in connection.execute(_ROWS_BY_TIME, (topic, FRAME_TYPE)):
            last = key
            yield data
    except sqlite3.Error as error:
        if str(error) == _INTERRUPTED:
            raise
        # It may be the index that is damaged; the table is in the order of recording.
        for data, *_ in connection.execute(_ROWS_AFTER, (topic, FRAME_TYPE, *last)):
            yield data
        raise
