# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags hold what was written, in every form that recorders give them."""

from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pytest
import yaml
from harness_bags import (
    STORAGES,
    SUFFIXES,
    Storage,
    assert_good_until,
    both_storages,
    equal,
    mcap_file,
    rosbag2,
    serialized,
    type_store,
    write_bag,
    write_messages,
)
from harness_frames import make_frames
from hypothesis import given, settings
from hypothesis import strategies as st

from retrolidar_ros.bag import FRAME_TYPE, FrameWriter, read_frames
from retrolidar_ros.sensor.frame import Frame, ZoneGrid

FRAME_HASH = 'RIHS01_55fececcaa4f65fa308471ca99d0871830bfe9d01c88f720e0675c50b85841cb'  # rosidl's


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
def test_other_tools_read_what_is_written(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(10, side=8)
    with FrameWriter(tmp_path / 'bag', storage, '/left/frames', 'left_optical_frame') as writer:
        for frame in frames:
            writer.write(frame, received_ns=frame.stamp_ns + 5)
    from rosbags.interfaces import QosReliability

    with rosbag2.Reader(tmp_path / 'bag') as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ('/left/frames', FRAME_TYPE)
        assert connection.digest == FRAME_HASH
        assert 'MSG: builtin_interfaces/Time\nint32 sec' in connection.msgdef.data
        (qos,) = connection.ext.offered_qos_profiles
        assert qos.reliability is QosReliability.RELIABLE
        assert reader.message_count == len(frames)
        for frame, (_, time, data) in zip(frames, reader.messages(), strict=True):
            decoded: Any = type_store().deserialize_cdr(data, FRAME_TYPE)
            assert time == frame.stamp_ns + 5
            assert decoded.header.frame_id == 'left_optical_frame'
            assert decoded.header.stamp.sec * 10**9 + decoded.header.stamp.nanosec == time - 5
            assert (decoded.sequence, decoded.rows, decoded.columns) == (frame.sequence, 8, 8)
            np.testing.assert_array_equal(decoded.distance, frame.distance)
            np.testing.assert_array_equal(decoded.status, frame.status)
    metadata = yaml.safe_load((tmp_path / 'bag' / 'metadata.yaml').read_text())
    assert metadata['rosbag2_bagfile_information']['version'] == 8  # which Humble reads


@pytest.mark.parametrize(
    ('storage', 'compression'), [*product(STORAGES, ('FILE', 'MESSAGE')), ('mcap', 'STORAGE')]
)
def test_compressed_bags(tmp_path: Path, storage: Storage, compression: str) -> None:
    frames = make_frames(100)
    messages = serialized(frames)
    write_messages(tmp_path / 'bag', messages, storage, compression)
    assert equal(read_frames(tmp_path / 'bag'), frames)


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'use_chunking': False},
        *({'compression': compression} for compression in ('LZ4', 'ZSTD')),
        {'use_statistics': False, 'use_summary_offsets': False, 'repeat_channels': False},
    ],
)
def test_any_mcap_file(tmp_path: Path, options: dict[str, Any]) -> None:
    frames = make_frames(200)  # in 14 chunks
    file = tmp_path / 'a.mcap'
    file.write_bytes(mcap_file(frames, **options))
    assert equal(read_frames(file), frames)


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
