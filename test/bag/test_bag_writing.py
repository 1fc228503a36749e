# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a bag writer refuses, what it leaves when it is ended, and what it needs."""

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness_bags import (
    Storage,
    both_storages,
    equal,
    read_all,
    serialized,
    write_bag,
    write_messages,
)
from harness_frames import make_frames

from retrolidar_ros.bag import BagError, FrameWriter, read_frames
from retrolidar_ros.sensor.frame import Frame


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
    subprocess.run(
        [sys.executable, '-c', script, str(tmp_path / 'bag'), storage],
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
        check=False,
    )
    read, error = read_all(tmp_path / 'bag')
    assert len(read) >= 750
    assert equal(read, make_frames(1000)[: len(read)])
    assert error is not None
