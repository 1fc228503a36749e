# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages from the MCAP and SQLite files of rosbag2, as far as they are good.

Written here, so that a recording that a power cut has damaged is saved. Such an MCAP file has no
index, and a last chunk that is cut off and may hold a minute of frames, of which the `mcap` library
yields nothing: it is read record by record. A cut SQLite file is read to its last whole page.
"""

import os
import re
import shutil
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing
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


def read_mcap(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from an MCAP file, as they were recorded."""
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

    def messages(self) -> Iterator[bytes]:
        """Yield the messages of the topic; DamageError after the last good one."""
        if self._read(0, len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise DamageError('not an MCAP file')
        position = len(_MCAP_MAGIC)
        opcode = None
        while opcode != _FOOTER:
            opcode, length = _RECORD.unpack(self._read(position, _RECORD.size))
            begin = position + _RECORD.size
            is_whole = begin + length <= self._size and opcode != 0
            try:
                if opcode == _CHUNK:  # of one that is cut off, the first messages are good
                    yield from self._chunk(self._read(begin, min(length, self._size - begin)))
                elif is_whole and opcode in (_SCHEMA, _CHANNEL, _MESSAGE):
                    yield from self._take(opcode, self._read(begin, length))
            except (DamageError, OSError) as error:
                raise DamageError(f'the record at byte {position}: {error}') from error
            except (struct.error, UnicodeDecodeError) as error:
                raise DamageError(f'the record at byte {position}: damaged') from error
            if not is_whole:
                raise DamageError(f'no whole record at byte {position}')
            position = begin + length
        if self._read(position, len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise DamageError(f'no end mark at byte {position}')

    def _chunk(self, data: bytes) -> Iterator[bytes]:
        _, _, size, checksum, length = _CHUNK_HEAD.unpack_from(data)
        compression = data[_CHUNK_HEAD.size :][:length].decode()
        records = decompress(compression, data[_CHUNK_HEAD.size + length + 8 :])
        if len(records) == size and checksum not in (0, crc32(records)):
            raise DamageError('wrong checksum')
        position = 0
        while position < len(records):
            opcode, length = _RECORD.unpack_from(records, position)
            begin = position + _RECORD.size
            position = begin + length
            if position > len(records) or opcode == 0:
                raise DamageError('a record inside is cut off')
            yield from self._take(opcode, records[begin:position])
        if len(records) != size:
            raise DamageError(f'{len(records)} of {size} bytes')

    def _take(self, opcode: int, content: bytes) -> Iterator[bytes]:
        """Store a schema or a channel; yield the data of a message of the topic."""
        if opcode == _SCHEMA:
            self._schemas[_IDS.unpack_from(content)[0]] = _text(content, 2)
        elif opcode == _CHANNEL:
            channel, schema = _IDS.unpack_from(content)
            name, type_name = _text(content, _IDS.size), self._schemas.get(schema, 'unknown')
            self._types[name] = type_name
            self._wanted[channel] = name == self._topic and type_name == FRAME_TYPE
        elif opcode == _MESSAGE:
            channel, *_ = _MESSAGE_HEAD.unpack_from(content)
            if channel not in self._wanted:
                raise DamageError(f'channel {channel} is not defined')
            if self._wanted[channel]:
                yield content[_MESSAGE_HEAD.size :]

    def _read(self, position: int, length: int) -> bytes:
        """Return bytes of the file; DamageError if it ends before."""
        self._stream.seek(position)
        data = self._stream.read(length)
        if len(data) < length:
            raise DamageError(f'the file ends at byte {self._size}, where a record goes on')
        return data


def _text(data: bytes, start: int) -> str:
    (length,) = _UINT32.unpack_from(data, start)
    return data[start + _UINT32.size :][:length].decode()


_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEADER = Struct('>16sH10xI')  # magic, page size, pages
# Without the index, which may be damaged: the table is in the order of recording.
_ROWS = (
    "SELECT COALESCE(CAST(data AS BLOB), x'') FROM messages NOT INDEXED"
    ' WHERE topic_id IN (SELECT id FROM topics WHERE name = ? AND type = ?) ORDER BY id'
)
# By the index, and by what is whole in the table.
_COUNTS = (
    'SELECT COUNT(*) FROM messages UNION ALL SELECT COUNT(*) FROM messages NOT INDEXED'
    ' WHERE topic_id IN (SELECT id FROM topics)'
)
_TABLES = "SELECT name, type, sql FROM sqlite_master WHERE name IN ('messages', 'topics')"


def read_sqlite(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from an SQLite file, as they were recorded."""
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
        with TemporaryDirectory() as directory:
            if logs or (short and size % page):  # repaired as a copy, which leaves the bag as it is
                for part in (file, *logs):
                    shutil.copy(part, directory)
                file = Path(directory, file.name)
                if short:
                    os.truncate(file, size - size % page)  # else SQLite reads zeros after the end
            yield from _read_database(file, topic, types, 'rw' if logs else 'ro&immutable=1')
    except sqlite3.Error as error:
        raise DamageError(short or str(error)) from error
    if short:
        raise DamageError(short)


def _read_database(file: Path, topic: str, types: dict[str, str], mode: str) -> Iterator[bytes]:
    """Yield the messages of a topic from a database that may have lost its end."""
    uri = f'{file.absolute().as_uri()}?mode={mode}'
    with closing(sqlite3.connect(uri, uri=True)) as connection:
        connection.execute('PRAGMA writable_schema = ON')  # accepts a file without its end
        for name, kind, text in connection.execute(_TABLES):
            if kind != 'table' or re.search(r'\bAS\b', str(text), re.IGNORECASE):
                raise DamageError(f'{name} is computed, and no table that a recorder has written')
        for name, type_name in connection.execute('SELECT name, type FROM topics'):
            types[str(name)] = str(type_name)
        for (data,) in connection.execute(_ROWS, (topic, FRAME_TYPE)):
            yield data
        if len(set(connection.execute(_COUNTS))) > 1:
            raise DamageError('the table lacks messages that are in the index')
