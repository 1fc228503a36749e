# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags that are made to harm, or that a recorder was killed over."""

import os
import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

pytest.importorskip('rosbags', reason='bags are written with rosbags')

from harness_frames import make_frames
from test_bag import equal, mcap_file, read_all, write_bag

from retrolidar_ros.bag import FRAME_TYPE, FRAMES_TOPIC, FrameWriter, files, messages, writer
from retrolidar_ros.cli.main import main

TOPICS = f"""
CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT);
INSERT INTO topics VALUES (1, '{FRAMES_TOPIC}', '{FRAME_TYPE}');
"""
ENDLESS = """
CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n)
SELECT id, 1 AS topic_id, id AS timestamp, x'00' AS data FROM n;
"""
COMPUTED = """
CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER,
data BLOB GENERATED ALWAYS AS (zeroblob(900000000)));
INSERT INTO messages(topic_id, timestamp) VALUES (1, 1);
"""


@pytest.fixture(scope='module')
def types() -> Any:
    return writer._type_store()


@pytest.mark.parametrize('script', [ENDLESS, COMPUTED])
def test_a_computed_table_is_refused(tmp_path: Path, script: str) -> None:
    with sqlite3.connect(tmp_path / 'bag.db3') as connection:
        connection.executescript(TOPICS + script)
    frames, error = read_all(tmp_path / 'bag.db3')
    assert not frames
    assert 'messages is computed' in str(error)


def test_a_query_can_be_interrupted(tmp_path: Path) -> None:
    """Joins of a large table would keep SQLite busy for hours."""
    with sqlite3.connect(tmp_path / 'bag.db3') as connection:
        connection.executescript(TOPICS.replace('topics(id', 'messages(id').split(';')[0] + ';')
        connection.execute('CREATE TABLE many(x)')
        connection.executemany('INSERT INTO many VALUES (?)', [(n,) for n in range(3000)])
    script = (
        'import sqlite3, sys; from retrolidar_ros.bag import files as s\n'
        "s._TABLES = 'SELECT a.x, b.x, c.x FROM many a, many b, many c WHERE a.x + b.x + c.x < 0'\n"
        "print('ready', flush=True); list(s.read_sqlite(__import__('pathlib').Path(sys.argv[1]),"
        " 't', {}))\n"
    )
    command = [sys.executable, '-c', script, str(tmp_path / 'bag.db3')]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b'ready\n'
        time.sleep(0.3)  # within the query, which tells nobody
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=10)
    assert b'KeyboardInterrupt' in errors


def test_a_chunk_unpacks_to_the_limit_only(
    tmp_path: Path, types: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(messages, 'MOST_BYTES', 500)
    path = tmp_path / 'bag.mcap'
    path.write_bytes(mcap_file(types, make_frames(100), compression='ZSTD'))
    frames, error = read_all(path)
    assert not frames
    assert 'unpack to more than 500' in str(error)


def test_a_file_unpacks_to_the_limit_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    zstd = pytest.importorskip(messages._ZSTD)
    monkeypatch.setattr(messages, 'MOST_BYTES', 4096)
    path = tmp_path / 'bag.mcap.zstd'
    path.write_bytes(zstd.compress(bytes(10**8)))
    _, error = read_all(path)
    assert 'it unpacks to more than' in str(error)


def test_messages_out_of_order_are_held_to_the_limit_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, '_MOST_HELD', 1000)
    _, error = read_all(write_bag(tmp_path / 'bag', make_frames(100)))
    assert 'more than 1000 bytes of messages are out of order' in str(error)


@pytest.mark.parametrize('kind', ['pipe', 'device', 'directory'])
def test_metadata_that_is_no_file_is_not_read(tmp_path: Path, kind: str) -> None:
    frames = make_frames(10)
    write_bag(tmp_path / 'bag', frames)
    metadata = tmp_path / 'bag' / 'metadata.yaml'
    metadata.unlink()
    if kind == 'pipe':
        os.mkfifo(metadata)
    elif kind == 'device':
        metadata.symlink_to('/dev/zero')
    else:
        metadata.mkdir()
    read, error = read_all(tmp_path / 'bag')
    assert equal(read, frames)
    assert 'metadata.yaml is no file' in str(error)


def test_a_file_that_is_named_twice_is_read_once(tmp_path: Path) -> None:
    frames = make_frames(10)
    file = write_bag(tmp_path / 'bag', frames)
    metadata = file.with_name('metadata.yaml')
    content = yaml.safe_load(metadata.read_text())
    content['rosbag2_bagfile_information']['relative_file_paths'] *= 2
    metadata.write_text(yaml.safe_dump(content))
    read, error = read_all(tmp_path / 'bag')
    assert equal(read, frames)
    assert 'metadata.yaml is damaged' in str(error)


@pytest.mark.parametrize('mode', ['WAL', 'DELETE'])
def test_what_a_killed_recorder_has_left_is_read(tmp_path: Path, mode: str) -> None:
    """A copy of the files in the midst of a transaction is what a SIGKILL leaves."""
    frames = make_frames(400)
    file = write_bag(tmp_path / 'bag', frames, 'sqlite3')
    left = tmp_path / 'left'
    left.mkdir()
    with sqlite3.connect(file) as connection:
        connection.execute(f'PRAGMA journal_mode = {mode}')
        connection.execute('PRAGMA cache_size = 1')
        connection.execute('PRAGMA wal_autocheckpoint = 0')
        if mode == 'WAL':
            connection.execute('UPDATE messages SET topic_id = topic_id')
            connection.commit()
        connection.execute('DELETE FROM messages')
        for part in file.parent.glob(f'{file.name}*'):
            shutil.copy(part, left)
        connection.rollback()
    assert len(list(left.iterdir())) >= 2
    before = {part: part.read_bytes() for part in left.iterdir()}
    read, _ = read_all(left)
    assert equal(read, frames)
    assert {part: part.read_bytes() for part in left.iterdir()} == before


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_what_was_written_before_the_end_is_kept(tmp_path: Path, storage: str) -> None:
    """Of a process that is gone without a word."""
    script = (
        'import os, sys; from harness_frames import make_frames; from retrolidar_ros.bag import *\n'
        'writer = FrameWriter(sys.argv[1], sys.argv[2]); writer.__enter__()\n'
        'for frame in make_frames(3000, 8): writer.write(frame)\n'
        'os._exit(9)'
    )
    path = os.pathsep.join([str(Path(__file__).parent), *sys.path])
    subprocess.run(
        [sys.executable, '-c', script, str(tmp_path / 'bag'), storage],
        env={**os.environ, 'PYTHONPATH': path},
        check=False,
    )
    read, error = read_all(tmp_path / 'bag')
    assert len(read) >= 2000
    assert equal(read, make_frames(3000, 8)[: len(read)])
    assert error is not None


def test_chunks_of_one_time_cost_no_more_than_others(tmp_path: Path) -> None:
    """Seconds would be what sorting anew with every chunk takes."""
    frames = make_frames(20_000)
    stamps = np.zeros(len(frames), dtype=int)
    with FrameWriter(tmp_path / 'bag') as bag:
        for frame, stamp in zip(frames, stamps, strict=True):
            bag.write(frame, received_ns=int(stamp))
    began = time.process_time()
    read, _ = read_all(tmp_path / 'bag')
    assert time.process_time() - began < 5.0
    assert len(read) == len(frames)


def test_what_names_hold_does_not_reach_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with FrameWriter(tmp_path / 'bag', topic='/a\x1b[2J\x07' + 'b' * 10**6) as bag:
        bag.write(make_frames(1)[0])
    assert main(['decode', str(tmp_path / 'bag')]) == 2
    said = capsys.readouterr().err
    assert '\\x1b[2J\\x07' in said
    assert '\x1b' not in said
    assert len(said) < 2000


def test_a_picture_needs_the_name_of_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = write_bag(tmp_path / 'bag', make_frames(50))
    assert main(['plot', str(file), '-o', str(tmp_path)]) == 2
    assert f'{tmp_path} is a directory' in capsys.readouterr().err
