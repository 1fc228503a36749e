# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages from an SQLite file of rosbag2, up to its damage."""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory

from retrolidar_ros.bag.errors import DamageError
from retrolidar_ros.bag.serialized import FRAME_TYPE

_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEADER = Struct('>16sH10xI')  # magic, page size, pages
_ROWS = (
    "SELECT COALESCE(CAST(data AS BLOB), x''), timestamp, id FROM messages {}"
    ' WHERE topic_id IN (SELECT id FROM topics WHERE name = ? AND type = ?) {}'
)
_TABLES = "SELECT name, type, sql FROM sqlite_master WHERE name IN ('messages', 'topics')"
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
            with TemporaryDirectory() as directory:  # SQLite mends the copy, and leaves the bag
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
    interrupts: list[KeyboardInterrupt] = []

    def look_up() -> int:
        """Let Ctrl-C end a query; SQLite swallows what is raised in here."""
        try:
            return len(interrupts)
        except KeyboardInterrupt as interrupt:
            interrupts.append(interrupt)
            return 1

    with closing(
        sqlite3.connect(f'{file.absolute().as_uri()}?mode={mode}', uri=True)
    ) as connection:
        connection.set_progress_handler(look_up, _STEPS)
        try:
            yield from _messages(connection, topic, types)
        finally:
            if interrupts:
                raise interrupts[0]


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
    except sqlite3.Error:
        # It may be the index that is damaged; the table is in the order of recording.
        for data, *_ in connection.execute(_ROWS_AFTER, (topic, FRAME_TYPE, *last)):
            yield data
        raise
