# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames to and from rosbag2 bags, without ROS.

Bags are written with the `rosbags` library. They are read without it: in half the time, on
machines that do not have it, and up to the damage in what a power cut has left of a bag. So an
MCAP file is scanned, whatever its index says, and SQLite is told to bear with a lost end.
"""

from __future__ import annotations

import os
import re
import shutil
import sqlite3
import struct
import sys
from bisect import bisect_left
from collections.abc import Iterator
from contextlib import closing, contextmanager
from functools import cache
from importlib import import_module
from operator import itemgetter
from pathlib import Path, PurePath
from struct import Struct
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING, Any, BinaryIO, Literal
from zlib import crc32

import numpy as np
import yaml
from numpy.typing import NDArray

from retrolidar_ros.frame import ZONE_SHAPES, Frame, ZoneGrid, check_frame_arrays
from retrolidar_ros.resources import shared_file

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

FRAME_TYPE = 'retrolidar_ros/msg/Frame'
FRAMES_TOPIC = '/retrolidar/frames'

_INSTALL = 'pip install "retrolidar_ros[bags]"'


class BagError(ValueError):
    """A bag cannot be written, or cannot be read, or not to its end."""


class _DamageError(Exception):
    """From here on a file cannot be read; the frames before are good."""


# Writing


@cache
def _type_store() -> Typestore:
    """Return the ROS types and ours."""
    from rosbags import typesys

    definition = shared_file('msg/Frame.msg').read_text(encoding='utf-8')
    types = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    types.register(typesys.get_types_from_msg(definition, FRAME_TYPE))
    return types


class FrameWriter:
    """Writes frames to a new bag; a context manager.

    What was written is kept when the block ends with an exception.
    """

    def __init__(
        self,
        path: str | Path,
        storage: Literal['mcap', 'sqlite3'] = 'mcap',
        topic: str = FRAMES_TOPIC,
        frame_id: str = 'retrolidar_optical_frame',
    ) -> None:
        """Prepare a bag; it is made on entering the block.

        Parameters
        ----------
        path
            The directory to make; its parents are made if need be.
        storage
            The kind of file that holds the messages.
        topic
            Absolute name of the topic.
        frame_id
            The optical frame, for the messages' headers.

        Raises
        ------
        BagError
            If the path exists, the storage is unknown, or `rosbags` is not installed.
        """
        try:
            from rosbags import interfaces, rosbag2
        except ImportError as error:
            raise BagError(f'writing a bag needs the rosbags library: {_INSTALL}') from error
        self._errors = (OSError, sqlite3.Error, struct.error, rosbag2.WriterError)
        if storage not in ('mcap', 'sqlite3'):
            raise BagError(f'storage {storage!r} is neither mcap nor sqlite3')
        with self._bag_errors():
            # Version 8 is the last whose QoS profiles ROS 2 Humble can read.
            self._writer = rosbag2.Writer(
                path, version=8, storage_plugin=rosbag2.StoragePlugin[storage.upper()]
            )
            self._types = _type_store()
        unspecified = interfaces.QosTime(0, 0)
        self._qos = interfaces.Qos(
            history=interfaces.QosHistory.KEEP_LAST,
            depth=10,
            reliability=interfaces.QosReliability.RELIABLE,
            durability=interfaces.QosDurability.VOLATILE,
            deadline=unspecified,
            lifespan=unspecified,
            liveliness=interfaces.QosLiveliness.AUTOMATIC,
            liveliness_lease_duration=unspecified,
            avoid_ros_namespace_conventions=False,
        )
        self._topic = topic
        self._frame_id = frame_id

    @contextmanager
    def _bag_errors(self) -> Iterator[None]:
        """Turn the errors of the libraries into `BagError`."""
        try:
            yield
        except self._errors as error:
            raise BagError(str(error)) from error

    def __enter__(self) -> FrameWriter:
        """Make the bag; BagError if that fails."""
        with self._bag_errors():
            self._writer.open()
            self._connection = self._writer.add_connection(
                self._topic, FRAME_TYPE, typestore=self._types, offered_qos_profiles=[self._qos]
            )
        return self

    def write(self, frame: Frame, received_ns: int | None = None) -> None:
        """Append a frame.

        Parameters
        ----------
        frame
            Its `stamp_ns` becomes the header's stamp.
        received_ns
            The bag's own timestamp of the message [ns]; the stamp if not given.

        Raises
        ------
        ValueError
            If an array has not one value a zone.
        BagError
            If a number does not fit the message, or the file cannot be written.
        """
        grid = frame.grid
        arrays: dict[str, NDArray[Any]] = {
            'distance': np.ascontiguousarray(frame.distance, np.float32),
            'signal': np.ascontiguousarray(frame.signal, np.float32),
            'ambient': np.ascontiguousarray(frame.ambient, np.float32),
            'status': np.ascontiguousarray(frame.status, np.uint8),
        }
        check_frame_arrays(grid, **arrays)
        received_ns = frame.stamp_ns if received_ns is None else received_ns
        for time_ns in (frame.stamp_ns, received_ns):
            if not 0 <= time_ns < 2**31 * 10**9:
                raise BagError(f'frame {frame.sequence}: {time_ns} ns is no ROS time')
        types = self._types.types
        stamp = types['builtin_interfaces/msg/Time'](*divmod(frame.stamp_ns, 10**9))
        message = types[FRAME_TYPE](
            header=types['std_msgs/msg/Header'](stamp, self._frame_id),
            sequence=frame.sequence,
            sensor_time=frame.sensor_time_us,
            rows=grid.rows,
            columns=grid.columns,
            **arrays,
        )
        with self._bag_errors():
            data = self._types.serialize_cdr(message, FRAME_TYPE)
            self._writer.write(self._connection, received_ns, data)

    def __exit__(
        self,
        exc_type: type[BaseException] | None,
        exc_value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the bag; BagError if that fails."""
        with self._bag_errors():
            self._writer.close()


# Reading: messages to frames

_CDR_LITTLE_ENDIAN = b'\0\1\0\0'  # fields are aligned from its end
_STAMP = Struct('<iII')  # seconds, nanoseconds, and the length of the frame_id that follows
_SENSOR = Struct('<QBB')  # sensor time, rows, columns
_UINT32 = Struct('<I')
_GRIDS = {shape: ZoneGrid(*shape) for shape in ZONE_SHAPES}
_ARRAYS = (
    ('distance', np.dtype('<f4')),
    ('signal', np.dtype('<f4')),
    ('ambient', np.dtype('<f4')),
    ('status', np.dtype('u1')),
)


def _decode_frame(data: bytes) -> Frame:
    """Return the frame in a serialized message; _DamageError if there is none."""
    origin = len(_CDR_LITTLE_ENDIAN)
    if data[:origin] != _CDR_LITTLE_ENDIAN:
        raise _DamageError(f'a message starts with {data[:origin]!r}, not as little-endian CDR')
    try:
        seconds, nanoseconds, length = _STAMP.unpack_from(data, origin)
        position = origin + ((_STAMP.size + length + 3) & -4)
        (sequence,) = _UINT32.unpack_from(data, position)
        position = origin + ((position - origin + _UINT32.size + 7) & -8)
        sensor_time_us, rows, columns = _SENSOR.unpack_from(data, position)
        grid = _GRIDS.get((rows, columns))
        if grid is None:
            raise _DamageError(f'a frame of {rows}x{columns} zones')
        position += (_SENSOR.size + 3) & -4
        arrays: list[NDArray[Any]] = []
        for name, dtype in _ARRAYS:
            (length,) = _UINT32.unpack_from(data, position)
            if length != grid.zones:
                raise _DamageError(f'{name} has {length} values for {rows}x{columns} zones')
            position += _UINT32.size
            arrays.append(np.frombuffer(data, dtype, length, position))
            position += length * dtype.itemsize
    except (struct.error, ValueError) as error:
        raise _DamageError(f'a message ends early, after {len(data)} bytes') from error
    return Frame(seconds * 10**9 + nanoseconds, sequence, sensor_time_us, grid, *arrays)


def read_frames(path: str | Path, topic: str = FRAMES_TOPIC) -> Iterator[Frame]:
    """Read a bag's frames one after the other, in the order of the bag's timestamps.

    Parameters
    ----------
    path
        A bag's directory, or one of its files: `.mcap`, `.db3`, or either compressed, `.zstd`.
    topic
        Absolute name of the topic.

    Raises
    ------
    BagError
        If there is no such path or topic, if the topic's type is another, if it has no frames,
        or if a library is missing. If the bag is damaged or its recording did not end properly:
        after the frames before the damage.
    """
    path = Path(path)
    types: dict[str, str] = {}
    frames = 0
    if not path.exists():
        raise BagError(f'{path} does not exist')
    try:
        for data in _read_bag(path, topic, types):
            yield _decode_frame(data)
            frames += 1
    except (_DamageError, OSError) as error:
        raise BagError(f'{path}: {error} (after {frames} frames)') from error
    if topic not in types:
        found = ', '.join(f'{name} ({type_name})' for name, type_name in sorted(types.items()))
        raise BagError(f'{path}: no topic {topic}; there are: {found or "none"}')
    if types[topic] != FRAME_TYPE:
        raise BagError(f'{path}: {topic} is of type {types[topic]}, not {FRAME_TYPE}')
    if not frames:
        raise BagError(f'{path}: {topic} has no frames')


# Reading: bags to messages

_METADATA_KEYS = {
    'version',
    'storage_identifier',
    'relative_file_paths',
    'starting_time',
    'duration',
    'message_count',
    'topics_with_message_count',
}
_ZSTD = 'compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd'
_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'


def _read_bag(path: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from all files of a bag; note the types of all topics."""
    if not path.is_dir():
        yield from _read_file(path, topic, types)
        return
    files, damage = _bag_files(path)
    try:
        for file in files:
            yield from _read_file(file, topic, types)
    except _DamageError as error:
        raise _DamageError(f'{file.name}: {error}') from error
    if damage is not None:
        raise damage


def _bag_files(bag: Path) -> tuple[list[Path], _DamageError | None]:
    """Return the files of a bag, oldest first, and what is wrong with its metadata."""
    found = [file for file in bag.iterdir() if re.search(r'\.(mcap|db3)(\.zstd)?$', file.name)]
    # Recorders number their files: bag_9 comes before bag_10.
    found.sort(key=lambda file: ([int(digits) for digits in re.findall(r'\d+', file.name)], file))
    if not found:
        return found, _DamageError('no .mcap or .db3 file in this directory')
    try:
        content = yaml.safe_load((bag / 'metadata.yaml').read_bytes())
        information = content['rosbag2_bagfile_information']
        named = [bag / PurePath(name).name for name in information['relative_file_paths']]
        damaged = not information.keys() >= _METADATA_KEYS
    except FileNotFoundError:
        return found, _DamageError('no metadata.yaml: the recording did not end properly')
    except (yaml.YAMLError, AttributeError, LookupError, TypeError, ValueError, RecursionError):
        damaged = True
    if damaged:
        return found, _DamageError('metadata.yaml is damaged')
    if set(named) != set(found):
        names = sorted(file.name for file in set(named) ^ set(found))
        return found, _DamageError(f'metadata.yaml and the directory differ in {", ".join(names)}')
    return named, None


def _read_file(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from one file of a bag, oldest first."""
    if file.suffix == '.zstd':
        with TemporaryDirectory() as directory:
            plain = Path(directory, file.stem)
            damage = _decompress_file(file, plain)
            if damage is None or plain.stat().st_size:
                yield from _read_file(plain, topic, types)
        if damage is not None:
            raise damage
        return
    readers = {'.mcap': _read_mcap, '.db3': _read_sqlite}
    if file.suffix not in readers:
        raise _DamageError('the name does not end in .mcap or .db3')
    if not file.stat().st_size:
        raise _DamageError('the file is empty')
    for data in readers[file.suffix](file, topic, types):
        yield _decompress('zstd', data) if data.startswith(_ZSTD_MAGIC) else data


def _decompress_file(file: Path, plain: Path) -> _DamageError | None:
    """Decompress as much of a file as can be; return what is wrong with the rest."""
    zstd = _library(_ZSTD)
    with zstd.open(file) as source, plain.open('wb') as target:
        try:
            shutil.copyfileobj(source, target)
        except (zstd.ZstdError, EOFError) as error:
            return _DamageError(str(error))
    return None


def _decompress(compression: str, data: bytes) -> bytes:
    """Return as much decompressed data as there is."""
    if compression == '':
        return data
    if compression == 'zstd':
        zstd = _library(_ZSTD)
        decompressor, failure = zstd.ZstdDecompressor(), zstd.ZstdError
    elif compression == 'lz4':
        decompressor, failure = _library('lz4.frame').LZ4FrameDecompressor(), RuntimeError
    else:
        raise _DamageError(f'unknown compression {compression!r}')
    try:
        decompressed: bytes = decompressor.decompress(data)
    except failure as error:
        raise _DamageError(f'{compression}: {error}') from error
    return decompressed


def _library(name: str) -> Any:
    """Import a library that comes with rosbags."""
    try:
        return import_module(name)
    except ImportError as error:
        raise BagError(f'reading a compressed bag needs {name}: {_INSTALL}') from error


_SQLITE_MAGIC = b'SQLite format 3\0'
_SQLITE_HEADER = Struct('>16sH10xI')  # magic, page size, pages
_ROWS = (
    "SELECT COALESCE(CAST(data AS BLOB), x''), timestamp, id FROM messages {}"
    ' WHERE topic_id IN (SELECT id FROM topics WHERE name = ? AND type = ?) {}'
)
_ROWS_BY_TIME = _ROWS.format('', 'ORDER BY timestamp, id')
_ROWS_AFTER = _ROWS.format('NOT INDEXED', 'AND (timestamp, id) > (?, ?) ORDER BY id')


def _read_sqlite(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from an SQLite file, oldest first."""
    with file.open('rb') as stream:
        header = stream.read(_SQLITE_HEADER.size).ljust(_SQLITE_HEADER.size, b'\0')
    magic, page, pages = _SQLITE_HEADER.unpack(header)
    if magic != _SQLITE_MAGIC:
        raise _DamageError('not an SQLite file')
    page = 2**16 if page == 1 else page
    size = file.stat().st_size
    has_log = file.with_name(f'{file.name}-wal').exists()  # what the file lacks is in there
    is_short = size < page * pages and not has_log
    short = f'the file ends at byte {size} of {page * pages}' if is_short else ''
    try:
        if short and size % page:
            with TemporaryDirectory() as directory:
                whole = Path(shutil.copy(file, directory))
                os.truncate(whole, size - size % page)  # else SQLite reads zeros after the end
                yield from _read_database(whole, topic, types)
        else:
            yield from _read_database(file, topic, types, immutable=not has_log)
    except sqlite3.Error as error:
        raise _DamageError(short or str(error)) from error
    if short:
        raise _DamageError(short)


def _read_database(
    file: Path, topic: str, types: dict[str, str], *, immutable: bool = True
) -> Iterator[bytes]:
    """Yield the messages of a topic from a database that may have lost its end."""
    last = [-(2**63), 0]  # timestamp and id
    uri = f'{file.absolute().as_uri()}?mode=ro&immutable={immutable:d}'
    with closing(sqlite3.connect(uri, uri=True)) as connection:
        connection.execute('PRAGMA writable_schema = ON')  # bears with a file that lost its end
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


_MCAP_MAGIC = b'\x89MCAP0\r\n'
_FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = 2, 3, 4, 5, 6
_RECORD = Struct('<BQ')  # opcode, length of the content
_MESSAGE_HEAD = Struct('<HIQQ')  # channel, sequence, log time, publish time
_CHUNK_HEAD = Struct('<QQQII')  # first and last log time, size, CRC-32, length of compression
_IDS = Struct('<HH')  # channel and schema


def _read_mcap(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from an MCAP file, oldest first."""
    with file.open('rb') as stream:
        yield from _McapFile(stream, file.stat().st_size, topic, types).messages()


class _McapFile:
    """An MCAP file (version 0, see mcap.dev/spec), read by its records, whatever its index."""

    def __init__(self, stream: BinaryIO, size: int, topic: str, types: dict[str, str]) -> None:
        self._stream = stream
        self._size = size
        self._topic = topic
        self._types = types
        self._schemas: dict[int, str] = {}
        self._wanted: dict[int, bool] = {}  # by channel
        self._pieces: list[tuple[int, int, int, bool]] = []  # first log time, start, end, chunk?

    def messages(self) -> Iterator[bytes]:
        """Yield the messages of the topic by log time; _DamageError after the last good one."""
        damage = None
        try:
            self._scan()
        except (_DamageError, struct.error, UnicodeDecodeError) as error:
            damage = (
                error if isinstance(error, _DamageError) else _DamageError('a record is damaged')
            )
        pending: list[tuple[int, bytes]] = []
        for first_time, start, end, is_chunk in sorted(self._pieces):
            pending.sort(key=itemgetter(0))
            older = bisect_left(pending, first_time, key=itemgetter(0))
            yield from (data for _, data in pending[:older])
            del pending[:older]
            try:
                for time, data in self._piece(start, end, is_chunk):
                    if time < first_time:
                        raise _DamageError('a message is older than its chunk')
                    pending.append((time, data))
            except (_DamageError, struct.error, UnicodeDecodeError) as error:
                reason = error if isinstance(error, _DamageError) else 'damaged'
                damage = _DamageError(f'the record at byte {start}: {reason}')
                break
        pending.sort(key=itemgetter(0))
        yield from (data for _, data in pending)
        if damage is not None:
            raise damage

    def _scan(self) -> None:
        """Find chunks, messages outside of chunks, and what channels there are."""
        if self._read(0, len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise _DamageError('not an MCAP file')
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
                raise _DamageError(f'no whole record at byte {position}')
            if opcode == _MESSAGE:
                time = _MESSAGE_HEAD.unpack(self._read(content, _MESSAGE_HEAD.size))[2]
                self._pieces.append((time, position, end, False))
            elif opcode in (_SCHEMA, _CHANNEL):
                self._define(opcode, self._read(content, length))
            position = end
        if self._read(position, len(_MCAP_MAGIC)) != _MCAP_MAGIC:
            raise _DamageError(f'no end mark at byte {position}')

    def _piece(self, start: int, end: int, is_chunk: bool) -> Iterator[tuple[int, bytes]]:
        """Yield (log time, data) of the topic's messages in a chunk or in a record."""
        data = self._read(start, end - start)
        if not is_chunk:
            yield from self._records(data)
            return
        _, _, size, checksum, length = _CHUNK_HEAD.unpack_from(data)
        compression = data[_CHUNK_HEAD.size :][:length].decode()
        records = _decompress(compression, data[_CHUNK_HEAD.size + length + 8 :])
        if len(records) == size and checksum not in (0, crc32(records)):
            raise _DamageError('wrong checksum')
        yield from self._records(records)
        if len(records) != size:
            raise _DamageError(f'{len(records)} of {size} bytes')

    def _records(self, records: bytes) -> Iterator[tuple[int, bytes]]:
        """Yield (log time, data) of the topic's messages in a run of records."""
        position = 0
        while position < len(records):
            opcode, length = _RECORD.unpack_from(records, position)
            content = position + _RECORD.size
            position = content + length
            if position > len(records) or opcode == 0:
                raise _DamageError('a record inside is cut off')
            if opcode == _MESSAGE:
                channel, _, time, _ = _MESSAGE_HEAD.unpack_from(records, content)
                if channel not in self._wanted:
                    raise _DamageError(f'channel {channel} is not defined')
                if self._wanted[channel]:
                    yield time, records[content + _MESSAGE_HEAD.size : position]
            elif opcode in (_SCHEMA, _CHANNEL):
                self._define(opcode, records[content:position])

    def _define(self, opcode: int, content: bytes) -> None:
        """Take note of a schema or a channel."""
        if opcode == _SCHEMA:
            self._schemas[_IDS.unpack_from(content)[0]] = _text(content, 2)
        else:
            channel, schema = _IDS.unpack_from(content)
            name, type_name = _text(content, _IDS.size), self._schemas.get(schema, 'unknown')
            self._types[name] = type_name
            self._wanted[channel] = name == self._topic and type_name == FRAME_TYPE

    def _read(self, position: int, length: int) -> bytes:
        """Return bytes of the file; _DamageError if it ends before."""
        self._stream.seek(position)
        data = self._stream.read(length)
        if len(data) < length:
            raise _DamageError(f'the file ends at byte {self._size}, where a record goes on')
        return data


def _text(data: bytes, start: int) -> str:
    """Return the string at a place in a record."""
    (length,) = _UINT32.unpack_from(data, start)
    return data[start + _UINT32.size :][:length].decode()
