# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags hold what was written, in every form that recorders give them, or say what is refused."""

import os
import sys
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
    read_all,
    rosbag2,
    serialized,
    type_store,
    write_bag,
    write_messages,
)
from harness_firmware import run
from harness_frames import make_frames
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from retrolidar_ros.bag import FRAME_TYPE, BagError, FrameWriter, read_frames
from retrolidar_ros.sensor.frame import Frame, ZoneGrid

FRAME_HASH = 'RIHS01_55fececcaa4f65fa308471ca99d0871830bfe9d01c88f720e0675c50b85841cb'  # rosidl's


def any_frames(side: int) -> st.SearchStrategy[list[Frame]]:
    """Draw frames in order of time, of any numbers that the message can hold."""
    floats = hnp.arrays(np.uint32, side**2).map(lambda bits: bits.view(np.float32))
    frame = st.builds(
        Frame,
        stamp_ns=st.integers(0, 2**31 * 10**9 - 1),
        sequence=st.integers(0, 2**32 - 1),
        sensor_time_us=st.integers(0, 2**64 - 1),
        grid=st.just(ZoneGrid(side, side)),
        distance=floats,
        signal=floats,
        ambient=floats,
        status=hnp.arrays(np.uint8, side**2),
    )
    return st.lists(frame, min_size=1, max_size=5).map(
        lambda frames: sorted(frames, key=lambda one: one.stamp_ns)
    )


@both_storages
@settings(max_examples=15)
@given(
    frames=st.sampled_from([4, 8]).flatmap(any_frames),
    frame_id=st.text(st.characters(codec='ascii'), max_size=9),
)
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
    with rosbag2.Reader(tmp_path / 'bag') as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ('/left/frames', FRAME_TYPE)
        assert connection.digest == FRAME_HASH
        assert 'MSG: builtin_interfaces/Time\nint32 sec' in connection.msgdef.data
        assert connection.ext.offered_qos_profiles == []  # for which rosbag2 offers its default
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
    write_messages(tmp_path / 'bag', serialized(frames), storage, compression)
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


@both_storages
def test_a_bag_in_eleven_files(tmp_path: Path, storage: Storage) -> None:
    """As a recorder with a size limit writes it."""
    frames, bag = make_frames(55), tmp_path / 'bag'
    names = [f'bag_{index}{SUFFIXES[storage]}' for index in range(11)]
    bag.mkdir()
    for index, name in enumerate(names):
        part = tmp_path / f'part_{index}'
        write_bag(part, frames[5 * index : 5 * index + 5], storage).rename(bag / name)
    content = yaml.safe_load((part / 'metadata.yaml').read_text())
    content['rosbag2_bagfile_information']['relative_file_paths'] = names
    last, metadata = bag / names[-1], bag / 'metadata.yaml'
    metadata.write_text(yaml.safe_dump(content))
    assert equal(read_frames(bag), frames)
    last.rename(tmp_path / 'last')
    assert assert_good_until(bag, frames, f'differ in {names[-1]}') == 50
    (tmp_path / 'last').rename(last)
    metadata.unlink()
    (bag / names[3]).write_bytes(b'')
    assert assert_good_until(bag, frames, f'{names[3]}: the file is empty') == 15


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
        wrong: list[tuple[str, int]] = [('stamp_ns', -1), ('stamp_ns', 2**31 * 10**9)]
        wrong += [('sequence', -1), ('sequence', 2**32), ('sensor_time_us', 2**64)]
        for name, value in wrong:
            with pytest.raises(BagError):
                writer.write(Frame(**{**vars(frames[0]), name: value}))
        for received_ns in (-5, 2**63):
            with pytest.raises(BagError, match=f'{received_ns} ns'):
                writer.write(frames[0], received_ns=received_ns)
        with pytest.raises(ValueError, match='signal has shape'):
            writer.write(Frame(**{**vars(frames[0]), 'signal': np.zeros(3, np.float32)}))
        writer.write(frames[1])
    assert equal(read_frames(tmp_path / 'bag'), frames)


@both_storages
def test_rosbags_is_needed_to_write_and_to_decompress_only(
    tmp_path: Path, storage: Storage, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames = make_frames(3)
    write_bag(tmp_path / 'bag', frames, storage)
    write_messages(tmp_path / 'zstd', serialized(frames), storage, 'FILE')
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
def test_no_file_stays_open(tmp_path: Path, storage: Storage) -> None:
    frames = make_frames(50)
    before = open_files()
    file = write_bag(tmp_path / 'bag', frames, storage)
    write_messages(tmp_path / 'zstd', serialized(frames), storage, 'FILE')
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


@both_storages
def test_what_was_written_before_a_sudden_end_is_kept(tmp_path: Path, storage: Storage) -> None:
    script = (
        'import os, sys; from harness_frames import make_frames; from retrolidar_ros.bag import *\n'
        'writer = FrameWriter(sys.argv[1], sys.argv[2]); writer.__enter__()\n'
        'for frame in make_frames(1000): writer.write(frame)\n'
        'os._exit(9)'
    )
    path = os.pathsep.join(sys.path)
    run(sys.executable, '-c', script, tmp_path / 'bag', storage, PYTHONPATH=path)
    read, error = read_all(tmp_path / 'bag')
    assert len(read) >= 750
    assert equal(read, make_frames(1000)[: len(read)])
    assert error is not None
