# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags hold what was written, in every form that recorders give them, and up to any damage."""

from __future__ import annotations

import os
import random
import shutil
import sqlite3
import sys
from collections.abc import Iterable, Iterator
from io import BytesIO
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np
import pytest
import yaml
from harness_frames import make_frames
from hypothesis import given, settings
from hypothesis import strategies as st

from retrolidar_ros.bag import FRAME_TYPE, FRAMES_TOPIC, BagError, FrameWriter, read_frames
from retrolidar_ros.sensor.frame import Frame, ZoneGrid
from retrolidar_ros.settings.resources import shared_file

interfaces = pytest.importorskip('rosbags.interfaces', reason='bags are written with rosbags')
rosbag2 = pytest.importorskip('rosbags.rosbag2')
typesys = pytest.importorskip('rosbags.typesys')

Storage = Literal['mcap', 'sqlite3']
STORAGES: tuple[Storage, ...] = ('mcap', 'sqlite3')
SUFFIXES = {'mcap': '.mcap', 'sqlite3': '.db3'}
FRAME_HASH = 'RIHS01_55fececcaa4f65fa308471ca99d0871830bfe9d01c88f720e0675c50b85841cb'  # rosidl's
FRAME_ID = b'retrolidar_optical_frame'  # occurs once in every message

both_storages = pytest.mark.parametrize('storage', STORAGES)


def bits(frame: Frame) -> tuple[object, ...]:
    """Return all that a frame holds, comparable to the last bit of a NaN."""
    arrays = (frame.distance, frame.signal, frame.ambient, frame.status)
    assert [array.dtype.name for array in arrays] == ['float32', 'float32', 'float32', 'uint8']
    numbers = (frame.stamp_ns, frame.sequence, frame.sensor_time_us, frame.grid)
    return (*numbers, *(array.tobytes() for array in arrays))


def equal(left: Iterable[Frame], right: Iterable[Frame]) -> bool:
    """Tell whether two runs of frames are the same."""
    return list(map(bits, left)) == list(map(bits, right))


def write_bag(path: Path, frames: Iterable[Frame], storage: Storage = 'mcap') -> Path:
    """Write a bag and return its one data file."""
    with FrameWriter(path, storage) as writer:
        for frame in frames:
            writer.write(frame)
    return path / f'{path.name}{SUFFIXES[storage]}'


def read_all(path: Path) -> tuple[list[Frame], str | None]:
    """Return the frames of a bag, and what was said of it in the end."""
    frames: list[Frame] = []
    try:
        frames.extend(read_frames(path))
    except BagError as error:
        return frames, str(error)
    return frames, None


def assert_good_until(path: Path, frames: list[Frame], says: str) -> int:
    """Check that a bag's first frames come as they were and then an error; return how many."""
    read, error = read_all(path)
    assert error is not None
    assert says in error
    assert str(path) in error
    assert f'after {len(read)} frames' in error
    assert equal(read, frames[: len(read)])
    return len(read)


@pytest.fixture(scope='module')
def types() -> Any:
    """Return a type store that knows the frame, independent of the module under test."""
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    definition = shared_file('msg/Frame.msg').read_text()
    store.register(typesys.get_types_from_msg(definition, FRAME_TYPE))
    return store


def message(types: Any, frame: Frame, **changes: object) -> Any:
    """Return a frame as a message object, some fields changed."""
    stamp = types.types['builtin_interfaces/msg/Time'](*divmod(frame.stamp_ns, 10**9))
    fields = {
        'header': types.types['std_msgs/msg/Header'](stamp, 'a'),
        'sequence': frame.sequence,
        'sensor_time': frame.sensor_time_us,
        'rows': frame.grid.rows,
        'columns': frame.grid.columns,
        'distance': frame.distance,
        'signal': frame.signal,
        'ambient': frame.ambient,
        'status': frame.status,
    }
    return types.types[FRAME_TYPE](**{**fields, **changes})


def write_messages(
    path: Path,
    types: Any,
    messages: Iterable[tuple[int, bytes]],
    storage: Storage = 'mcap',
    compression: str = 'NONE',
    topic: str = FRAMES_TOPIC,
) -> None:
    """Write serialized messages with rosbags."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage.upper()])
    writer.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
    with writer:
        other = writer.add_connection('/other', 'std_msgs/msg/Header', typestore=types)
        connection = writer.add_connection(topic, FRAME_TYPE, typestore=types)
        for time, data in messages:
            writer.write(other, time, b'\0\1\0\0')
            writer.write(connection, time, data)


def serialized(types: Any, frames: Iterable[Frame]) -> list[tuple[int, bytes]]:
    """Return frames as timestamps and messages."""
    return [
        (frame.stamp_ns, bytes(types.serialize_cdr(message(types, frame), FRAME_TYPE)))
        for frame in frames
    ]


# What is written is read


@st.composite
def any_frames(draw: st.DrawFn) -> list[Frame]:
    """Draw frames in order of time, of any numbers that the message can hold."""
    side = draw(st.sampled_from([4, 8]))
    zones = side * side
    frames = []
    for stamp_ns in sorted(
        draw(st.lists(st.integers(0, 2**31 * 10**9 - 1), min_size=1, max_size=5))
    ):
        values = draw(st.binary(min_size=13 * zones, max_size=13 * zones))
        floats = np.frombuffer(values, np.float32, 3 * zones).reshape(3, zones)
        frames.append(
            Frame(
                stamp_ns=stamp_ns,
                sequence=draw(st.integers(0, 2**32 - 1)),
                sensor_time_us=draw(st.integers(0, 2**64 - 1)),
                grid=ZoneGrid(side, side),
                distance=floats[0],
                signal=floats[1],
                ambient=floats[2],
                status=np.frombuffer(values, np.uint8, zones, 12 * zones),
            )
        )
    return frames


@both_storages
@settings(max_examples=15, deadline=None, derandomize=True)
@given(frames=any_frames(), frame_id=st.text(st.characters(codec='ascii'), max_size=9))
def test_round_trip(storage: Storage, frames: list[Frame], frame_id: str) -> None:
    with TemporaryDirectory() as directory:
        path = Path(directory, 'bag')
        with FrameWriter(path, storage, frame_id=frame_id) as writer:
            for frame in frames:
                writer.write(frame)
        assert equal(read_frames(path), frames)
        # A data file alone is a bag.
        assert equal(read_frames(str(path / f'bag{SUFFIXES[storage]}')), frames)


@both_storages
def test_other_tools_read_what_is_written(tmp_path: Path, storage: Storage, types: Any) -> None:
    frames = make_frames(10, side=8)
    with FrameWriter(tmp_path / 'bag', storage, '/left/frames', 'left_optical_frame') as writer:
        for frame in frames:
            writer.write(frame, received_ns=frame.stamp_ns + 5)
    with rosbag2.Reader(tmp_path / 'bag') as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ('/left/frames', FRAME_TYPE)
        assert connection.digest == FRAME_HASH
        assert 'MSG: builtin_interfaces/Time\nint32 sec' in connection.msgdef.data
        (qos,) = connection.ext.offered_qos_profiles
        assert qos.reliability is interfaces.QosReliability.RELIABLE
        assert reader.message_count == len(frames)
        for frame, (_, time, data) in zip(frames, reader.messages(), strict=True):
            decoded: Any = types.deserialize_cdr(data, FRAME_TYPE)
            assert time == frame.stamp_ns + 5
            assert decoded.header.frame_id == 'left_optical_frame'
            assert decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == time - 5
            assert (decoded.sequence, decoded.rows, decoded.columns) == (frame.sequence, 8, 8)
            np.testing.assert_array_equal(decoded.distance, frame.distance)
            np.testing.assert_array_equal(decoded.status, frame.status)
    metadata = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    assert metadata['rosbag2_bagfile_information']['version'] == 8  # which Humble reads


@both_storages
def test_the_oldest_frame_comes_first(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(2600, side=8)  # more than two chunks of an MCAP file
    shuffled = random.Random(1).sample(frames, len(frames))
    with FrameWriter(tmp_path / 'bag', storage) as writer:
        for frame in shuffled:
            writer.write(frame, received_ns=frame.stamp_ns // 10**9)
    in_order = sorted(shuffled, key=lambda frame: frame.stamp_ns // 10**9)
    assert equal(read_frames(tmp_path / 'bag'), in_order)


@pytest.mark.parametrize(
    ('storage', 'compression'),
    [*product(STORAGES, ('FILE', 'MESSAGE')), ('mcap', 'STORAGE')],
)
def test_compressed_bags(tmp_path: Path, storage: Storage, compression: str, types: Any) -> None:
    frames = make_frames(100)
    messages = serialized(types, frames)
    write_messages(tmp_path / 'bag', types, messages, storage, compression)
    assert equal(read_frames(tmp_path / 'bag'), frames)


def mcap_file(types: Any, frames: Iterable[Frame], **options: Any) -> bytes:
    """Return an MCAP file made by its own library, with checksums and small chunks."""
    mcap_writer = pytest.importorskip('mcap.writer')
    stream = BytesIO()
    compression = mcap_writer.CompressionType[options.pop('compression', 'NONE')]
    writer = mcap_writer.Writer(stream, chunk_size=4096, compression=compression, **options)
    writer.start('ros2')
    definition = types.generate_msgdef(FRAME_TYPE, ros_version=2)[0]
    schema = writer.register_schema(FRAME_TYPE, 'ros2msg', definition.encode())
    channel = writer.register_channel(FRAMES_TOPIC, 'cdr', schema)
    for time, data in serialized(types, frames):
        writer.add_message(channel, time, data, time)
    writer.finish()
    return stream.getvalue()


@pytest.mark.parametrize(
    ('jitter', 'direction', 'options'),
    [
        *((jitter, direction, {}) for jitter in (0, 40, 1000) for direction in (1, -1)),
        (0, 1, {'use_chunking': False}),
        *((0, 1, {'compression': compression}) for compression in ('LZ4', 'ZSTD')),
        (0, 1, {'use_statistics': False, 'use_summary_offsets': False, 'repeat_channels': False}),
    ],
)
def test_any_mcap_file(
    tmp_path: Path, jitter: int, direction: int, options: dict[str, Any], types: Any
) -> None:
    frames = make_frames(200)  # in 14 chunks
    rng = random.Random(4)
    keys = {frame.sequence: direction * frame.sequence + rng.uniform(0, jitter) for frame in frames}
    recorded = sorted(frames, key=lambda frame: keys[frame.sequence])
    file = tmp_path / 'a.mcap'
    file.write_bytes(mcap_file(types, recorded, **options))
    assert equal(read_frames(file), frames)


def test_a_chunk_is_read_when_its_time_has_come(tmp_path: Path, types: Any) -> None:
    frames = make_frames(200)
    file = tmp_path / 'a.mcap'
    data = mcap_file(types, frames)
    file.write_bytes(data)
    reader = read_frames(file)
    first = next(reader)
    with file.open('r+b') as stream:  # what is lazy sees this
        stream.seek(len(data) // 2)
        stream.write(bytes(100))
    rest: list[Frame] = []
    with pytest.raises(BagError):
        rest.extend(reader)
    assert equal([first, *rest], frames[: 1 + len(rest)])
    assert 50 < len(rest) < 150


def split_bag(path: Path, frames: list[Frame], storage: Storage) -> list[str]:
    """Write a bag in eleven files, as a recorder with a size limit does; return their names."""
    step = -(-len(frames) // 11)
    names = [f'{path.name}_{index}{SUFFIXES[storage]}' for index in range(11)]
    path.mkdir()
    for index, name in enumerate(names):
        part = path.with_name(f'part_{index}')
        write_bag(part, frames[index * step : (index + 1) * step], storage).rename(path / name)
    metadata = yaml.safe_load((part / 'metadata.yaml').read_text())
    metadata['rosbag2_bagfile_information']['relative_file_paths'] = names
    (path / 'metadata.yaml').write_text(yaml.safe_dump(metadata))
    return names


@both_storages
def test_split_bags(tmp_path: Path, storage: Storage) -> None:
    frames, bag = make_frames(55), tmp_path / 'bag'
    names = split_bag(bag, frames, storage)
    assert equal(read_frames(bag), frames)
    last, metadata = bag / names[-1], bag / 'metadata.yaml'
    last.rename(tmp_path / 'last')
    assert assert_good_until(bag, frames, f'differ in {names[-1]}') == 50
    (tmp_path / 'last').rename(last)
    metadata.unlink()
    assert assert_good_until(bag, frames, 'no metadata.yaml') == len(frames)
    (bag / names[3]).write_bytes(b'')
    assert assert_good_until(bag, frames, f'{names[3]}: the file is empty') == 15


def test_a_write_ahead_log_is_read(tmp_path: Path) -> None:
    # Of a recording with the preset resilient, when the power was cut.
    frames = make_frames(20)
    file = write_bag(tmp_path / 'bag', frames[:10], 'sqlite3')
    rest = write_bag(tmp_path / 'rest', frames[10:], 'sqlite3')
    connection = sqlite3.connect(file)
    connection.execute('PRAGMA journal_mode = WAL')
    connection.execute('ATTACH ? AS rest', (str(rest),))
    connection.execute('INSERT INTO messages SELECT id + 10, 1, timestamp, data FROM rest.messages')
    connection.commit()
    after = tmp_path / 'after'
    shutil.copytree(file.parent, after)
    connection.close()
    assert (after / 'bag.db3-wal').stat().st_size
    assert equal(read_frames(after), frames)


# Damage


@both_storages
def test_truncated_files_are_read_to_the_cut(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(300)
    whole = write_bag(tmp_path / 'bag', frames, storage).read_bytes()
    cut = tmp_path / f'cut{SUFFIXES[storage]}'
    places = random.Random(2).sample(range(len(whole)), 30)
    counts = []
    for size in sorted([*places, 0, 1, 8, 9, 100, len(whole) - 1]):
        cut.write_bytes(whole[:size])
        counts.append(assert_good_until(cut, frames, ''))
        in_file = whole[:size].count(FRAME_ID)
        assert in_file - counts[-1] <= (1 if storage == 'mcap' else 20)  # a page of a database
    assert counts == sorted(counts)


def test_a_database_is_read_without_its_index(tmp_path: Path) -> None:
    frames = make_frames(400)
    file = write_bag(tmp_path / 'bag', frames, 'sqlite3')
    connection = sqlite3.connect(file)
    query = "SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'"
    ((root,),) = connection.execute(query)
    connection.close()
    data = bytearray(file.read_bytes())
    data[4096 * (root - 1) : 4096 * root] = bytes(4096)
    file.write_bytes(data)
    assert assert_good_until(file, frames, 'malformed') == len(frames)


@pytest.mark.parametrize(
    ('storage', 'compression'), [('mcap', 'STORAGE'), ('mcap', 'FILE'), ('sqlite3', 'FILE')]
)
def test_truncated_compression(
    tmp_path: Path, storage: Storage, compression: str, types: Any
) -> None:
    frames = make_frames(2000, side=8)
    write_messages(tmp_path / 'bag', types, serialized(types, frames), storage, compression)
    end = '.zstd' if compression == 'FILE' else ''
    file = tmp_path / 'bag' / f'bag{SUFFIXES[storage]}{end}'
    file.write_bytes(file.read_bytes()[: file.stat().st_size // (2 if end else 3)])
    assert assert_good_until(file, frames, '' if end else 'byte') > len(frames) // 4
    if end:
        file.write_bytes(b'not zstd')
        assert assert_good_until(file, frames, '') == 0


@pytest.mark.parametrize('page', [512, 65536])
def test_a_lost_end_is_told_though_no_frame_was_in_it(tmp_path: Path, page: int) -> None:
    frames = make_frames(20)
    file = write_bag(tmp_path / 'bag', frames, 'sqlite3')
    connection = sqlite3.connect(file)
    connection.execute(f'PRAGMA page_size = {page}')
    connection.execute('VACUUM')
    connection.execute('CREATE TABLE appendix (content)')
    connection.execute('INSERT INTO appendix VALUES (?)', (bytes(200_000),))
    connection.commit()
    connection.close()
    data = file.read_bytes()
    file.write_bytes(data[:-page])
    says = f'ends at byte {len(data) - page} of {len(data)}'
    assert assert_good_until(file, frames, says) == len(frames)


@pytest.mark.parametrize('compression', ['NONE', 'LZ4', 'ZSTD'])
def test_a_damaged_chunk_ends_the_frames(tmp_path: Path, compression: str, types: Any) -> None:
    frames, file = make_frames(200), tmp_path / 'a.mcap'
    whole = mcap_file(types, frames, compression=compression)
    first = 17 + int.from_bytes(whole[9:17], 'little')
    assert whole[first] == 6
    # Somewhere in a chunk, and in the uncompressed size of the first.
    for place, where, least, most in (
        (len(whole) // 2, '', 81, 100),
        (first + 25, first + 9, 0, 20),
    ):
        data = bytearray(whole)
        data[place] ^= 0x10
        file.write_bytes(data)
        assert least <= assert_good_until(file, frames, f'the record at byte {where}') <= most


def test_a_disk_error_ends_frames(
    tmp_path: Path, types: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    class FailingDisk(BytesIO):
        def read(self, size: int | None = -1) -> bytes:
            if size is not None and size > 1000 and self.tell() > len(data) // 2:
                raise OSError('Input/output error')
            return super().read(size)

    frames = make_frames(200)
    data = mcap_file(types, frames)
    file = tmp_path / 'a.mcap'
    file.write_bytes(data)
    monkeypatch.setattr(Path, 'open', lambda *_: FailingDisk(data))
    assert 80 < assert_good_until(file, frames, 'Input/output error') < 120


def test_a_tail_of_zeros_ends_the_frames(tmp_path: Path) -> None:
    # So file systems leave a file after a power cut.
    frames = make_frames(400)
    file = write_bag(tmp_path / 'bag', frames)
    data = file.read_bytes()
    half, footer = len(data) // 2, len(data) - 37
    file.write_bytes(data[:half] + bytes(half))
    assert assert_good_until(file, frames, '') >= data[:half].count(FRAME_ID) - 1
    file.write_bytes(data[:footer] + bytes(1000))
    assert assert_good_until(file, frames, f'no whole record at byte {footer}') == len(frames)


@both_storages
def test_flipped_bytes_raise_nothing_else(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(60)
    whole = write_bag(tmp_path / 'bag', frames, storage).read_bytes()
    file = tmp_path / f'flipped{SUFFIXES[storage]}'
    originals = set(map(bits, frames))
    rng = random.Random(3)
    errors = 0
    for _ in range(100):
        data = bytearray(whole)
        place = rng.randrange(len(data) - 8)
        data[place : place + 8] = rng.randbytes(8)
        file.write_bytes(data)
        read, error = read_all(file)
        errors += error is not None
        assert len(read) <= len(frames)
        assert sum(bits(frame) not in originals for frame in read) <= 2  # as many as 8 bytes hit
    assert errors > 10


@both_storages
def test_damaged_metadata_costs_no_frames(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(20)
    write_bag(tmp_path / 'bag', frames, storage)
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    text = metadata.read_bytes()
    damaged = [text[:size] for size in range(0, text.index(b'version'), 97)]
    for content in [*damaged, bytes(200), b'\xff\xfe', b'- 1', b'text', b'a: {']:
        metadata.write_bytes(content)
        assert assert_good_until(tmp_path / 'bag', frames, 'metadata.yaml is damaged') == 20
    metadata.unlink()
    assert assert_good_until(tmp_path / 'bag', frames, 'no metadata.yaml') == 20


@pytest.mark.parametrize(
    ('name', 'content', 'says'),
    [
        *((f'a{end}', b'', 'the file is empty') for end in SUFFIXES.values()),
        ('a.mcap', b'Dear reader,\n' * 99, 'not an MCAP file'),
        ('a.db3', b'Dear reader,\n' * 99, 'not an SQLite file'),
        ('a.txt', b'Dear reader,\n' * 99, 'does not end in .mcap or .db3'),
    ],
)
def test_what_is_no_bag(tmp_path: Path, name: str, content: bytes, says: str) -> None:
    assert assert_good_until(tmp_path, [], 'no .mcap or .db3 file') == 0
    file = tmp_path / name
    file.write_bytes(content)
    assert assert_good_until(file, [], says) == 0
    with pytest.raises(BagError, match='nowhere does not exist'):
        next(read_frames(tmp_path / 'nowhere'))


# The wrong bag


@both_storages
def test_a_wrong_topic_is_refused(tmp_path: Path, storage: Storage, types: Any) -> None:
    messages = serialized(types, make_frames(2))
    write_messages(tmp_path / 'bag', types, messages, storage, topic='/left/frames')
    write_bag(tmp_path / 'empty', [], storage)
    assert len(list(read_frames(tmp_path / 'bag', '/left/frames'))) == 2
    there = r'.*/left/frames \(retrolidar_ros/msg/Frame\).*'
    for bag, topic, message in (
        (
            'bag',
            FRAMES_TOPIC,
            rf'no topic {FRAMES_TOPIC}(?={there})(?=.*/other \(std_msgs/msg/Header)',
        ),
        ('bag', '/other', f'/other is of type std_msgs/msg/Header, not {FRAME_TYPE}'),
        ('empty', FRAMES_TOPIC, f'{FRAMES_TOPIC} has no frames'),
    ):
        with pytest.raises(BagError, match=message):
            next(read_frames(tmp_path / bag, topic))


def test_messages_that_are_no_frames(tmp_path: Path, types: Any) -> None:
    frames = make_frames(4)
    *messages, (time, data) = serialized(types, frames)
    wrongs: list[tuple[str, dict[str, Any]]] = [
        ('distance has 15 values for 4x4 zones', {'distance': np.zeros(15, np.float32)}),
        ('ambient has 64 values for 4x4 zones', {'ambient': np.zeros(64, np.float32)}),
        ('status has 0 values for 4x4 zones', {'status': np.zeros(0, np.uint8)}),
        ('a frame of 3x4 zones', {'rows': 3}),
    ]
    cases = [
        (says, types.serialize_cdr(message(types, frames[3], **changes), FRAME_TYPE))
        for says, changes in wrongs
    ]
    big_endian = types.serialize_cdr(message(types, frames[3]), FRAME_TYPE, little_endian=False)
    cases += [
        ('a message', wrong) for wrong in [big_endian, *(data[:n] for n in range(0, len(data), 19))]
    ]
    for index, (says, wrong) in enumerate(cases):
        path = tmp_path / f'bag_{index}'
        write_messages(path, types, [*messages, (time, wrong)])
        assert assert_good_until(path, frames, says) == 3


# Writing


def test_a_bag_that_cannot_be_made_or_exists_already(tmp_path: Path) -> None:
    file = write_bag(tmp_path / 'bag', make_frames(3))
    before = file.read_bytes()
    for path in (tmp_path / 'bag', tmp_path, file):
        with pytest.raises(BagError, match='exists already'):
            FrameWriter(path)
    assert file.read_bytes() == before
    with pytest.raises(BagError, match='Not a directory'), FrameWriter(file / 'bag'):
        pass
    storage: Any = 'rosbag1'
    with pytest.raises(BagError, match="'rosbag1' is not mcap or sqlite3"):
        FrameWriter(tmp_path / 'other', storage)


@both_storages
def test_numbers_that_do_not_fit_are_refused(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(2)
    with FrameWriter(tmp_path / 'bag', storage) as writer:
        writer.write(frames[0])
        for changes in (
            {'stamp_ns': -1},
            {'stamp_ns': 2**31 * 10**9},
            {'sequence': -1},
            {'sequence': 2**32},
            {'sensor_time_us': 2**64},
        ):
            with pytest.raises(BagError):
                writer.write(Frame(**{**vars(frames[0]), **changes}))
        for received_ns in (-5, 2**63):
            with pytest.raises(BagError, match=f'{received_ns} ns'):
                writer.write(frames[0], received_ns=received_ns)
        with pytest.raises(ValueError, match='signal has shape'):
            writer.write(Frame(**{**vars(frames[0]), 'signal': np.zeros(3, np.float32)}))
        writer.write(frames[1])
    assert equal(read_frames(tmp_path / 'bag'), frames)


@both_storages
def test_ctrl_c_does_not_cost_what_was_written(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(5)

    def interrupted() -> Iterator[Frame]:
        yield from frames
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_bag(tmp_path / 'bag', interrupted(), storage)
    assert equal(read_frames(tmp_path / 'bag'), frames)


# Libraries and handles


@both_storages
def test_rosbags_is_needed_to_write_and_to_decompress_only(
    tmp_path: Path, storage: Storage, types: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = make_frames(3)
    write_bag(tmp_path / 'bag', frames, storage)
    write_messages(tmp_path / 'zstd', types, serialized(types, frames), storage, 'FILE')
    for name in ('rosbags', 'backports.zstd', 'compression.zstd'):
        monkeypatch.setitem(sys.modules, name, None)
    assert equal(read_frames(tmp_path / 'bag'), frames)
    with pytest.raises(BagError, match=r'pip install rosbags'):
        FrameWriter(tmp_path / 'other', storage)
    with pytest.raises(BagError, match=r'zstd: pip install rosbags'):
        next(read_frames(tmp_path / 'zstd'))


def open_files() -> int:
    """Return how many files this process has open."""
    return len(os.listdir('/proc/self/fd'))


@pytest.mark.skipif(not Path('/proc/self/fd').is_dir(), reason='needs /proc to count open files')
@both_storages
def test_no_file_stays_open(tmp_path: Path, storage: Storage, types: Any) -> None:
    frames = make_frames(50)
    before = open_files()
    file = write_bag(tmp_path / 'bag', frames, storage)
    write_messages(tmp_path / 'zstd', types, serialized(types, frames), storage, 'FILE')
    list(read_frames(file))
    for path in (file, tmp_path / 'zstd'):
        part = read_frames(path)
        next(part)
        assert open_files() > before
        part.close()  # type: ignore[attr-defined]
    file.write_bytes(file.read_bytes()[:-100])
    assert read_all(file)[1] is not None
    with pytest.raises(BagError), FrameWriter(tmp_path / 'bag2', storage) as writer:
        writer.write(frames[0], received_ns=-1)
    assert open_files() == before
