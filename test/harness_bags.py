# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags as tests write and read them, with the package and with other libraries."""

import re
from collections.abc import Iterable
from functools import cache
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import pytest

from retrolidar_ros.bag import FRAME_TYPE, FRAMES_TOPIC, BagError, FrameWriter, read_frames
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.settings.files import shared_file

rosbag2 = pytest.importorskip('rosbags.rosbag2', reason='bags are written with rosbags')
typesys = pytest.importorskip('rosbags.typesys')

Storage = Literal['mcap', 'sqlite3']
STORAGES: tuple[Storage, ...] = ('mcap', 'sqlite3')
SUFFIXES = {'mcap': '.mcap', 'sqlite3': '.db3'}
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
    """Return the frames of a bag, and the text of the error that ended them."""
    frames: list[Frame] = []
    try:
        frames.extend(read_frames(path))
    except BagError as error:
        return frames, str(error)
    return frames, None


def assert_good_until(path: Path, frames: list[Frame], says: str) -> int:
    """Check that a bag's first frames come as they were and then an error; return how many.

    The error says what a regular expression is found in.
    """
    read, error = read_all(path)
    assert error is not None
    assert re.search(says, error), error
    assert str(path) in error
    assert f'after {len(read)} frames' in error
    assert equal(read, frames[: len(read)])
    return len(read)


@cache
def type_store() -> Any:
    """Return a type store that knows the frame, independent of the module under test."""
    store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    definition = shared_file('msg/Frame.msg').read_text()
    store.register(typesys.get_types_from_msg(definition, FRAME_TYPE))
    return store


def message(frame: Frame, **changes: object) -> Any:
    """Return a frame as a message object, some fields changed."""
    types = type_store().types
    stamp = types['builtin_interfaces/msg/Time'](*divmod(frame.stamp_ns, 10**9))
    fields = {
        'header': types['std_msgs/msg/Header'](stamp, 'a'),
        'sensor_time': frame.sensor_time_us,
        'rows': frame.grid.rows,
        'columns': frame.grid.columns,
    }
    for name in ('sequence', 'distance', 'signal', 'ambient', 'status'):
        fields[name] = getattr(frame, name)
    return types[FRAME_TYPE](**{**fields, **changes})


def write_messages(
    path: Path,
    messages: Iterable[tuple[int, bytes]],
    storage: Storage = 'mcap',
    compression: str = 'NONE',
    topic: str = FRAMES_TOPIC,
) -> None:
    """Write serialized messages with rosbags."""
    writer = rosbag2.Writer(path, version=9, storage_plugin=rosbag2.StoragePlugin[storage.upper()])
    writer.set_compression(rosbag2.CompressionMode[compression], rosbag2.CompressionFormat.ZSTD)
    with writer:
        other = writer.add_connection('/other', 'std_msgs/msg/Header', typestore=type_store())
        connection = writer.add_connection(topic, FRAME_TYPE, typestore=type_store())
        for time, data in messages:
            writer.write(other, time, b'\0\1\0\0')
            writer.write(connection, time, data)


def serialized(frames: Iterable[Frame]) -> list[tuple[int, bytes]]:
    """Return frames as timestamps and messages."""
    return [
        (frame.stamp_ns, bytes(type_store().serialize_cdr(message(frame), FRAME_TYPE)))
        for frame in frames
    ]


def mcap_file(frames: Iterable[Frame], **options: Any) -> bytes:
    """Return an MCAP file made by its own library, with checksums and small chunks."""
    mcap_writer = pytest.importorskip('mcap.writer')
    stream = BytesIO()
    compression = mcap_writer.CompressionType[options.pop('compression', 'NONE')]
    writer = mcap_writer.Writer(stream, chunk_size=4096, compression=compression, **options)
    writer.start('ros2')
    definition = type_store().generate_msgdef(FRAME_TYPE, ros_version=2)[0]
    schema = writer.register_schema(FRAME_TYPE, 'ros2msg', definition.encode())
    channel = writer.register_channel(FRAMES_TOPIC, 'cdr', schema)
    for time, data in serialized(frames):
        writer.add_message(channel, time, data, time)
    writer.finish()
    return stream.getvalue()
