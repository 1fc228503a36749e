# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags that are made to harm, or that a recorder was killed over."""

import shutil
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip('rosbags', reason='bags are written with rosbags')

from harness_bags import assert_good_until, equal, mcap_file, read_all, write_bag
from harness_frames import make_frames

from retrolidar_ros.bag import FRAME_TYPE, FRAMES_TOPIC, FrameWriter, files, messages
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


def test_what_unpacks_or_is_out_of_order_is_held_to_the_limit_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zstd = pytest.importorskip(messages._ZSTD)
    frames = make_frames(100)
    packed, file = tmp_path / 'a.mcap', tmp_path / 'b.mcap.zstd'
    packed.write_bytes(mcap_file(frames, compression='ZSTD'))
    file.write_bytes(zstd.compress(bytes(10**8)))
    plain = write_bag(tmp_path / 'bag', frames)
    for module, name, limit, path, read, says in (
        (messages, 'MAX_BYTES', 500, packed, 0, 'unpack to more than 500'),
        (messages, 'MAX_BYTES', 4096, file, 0, 'it unpacks to more than'),
        (files, '_MAX_HELD', 1000, plain, 100, 'more than 1000 bytes of messages are out of'),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(module, name, limit)
            assert assert_good_until(path, frames, says) == read


@pytest.mark.parametrize('mode', ['WAL', 'DELETE'])
def test_what_a_killed_recorder_has_left_is_read(tmp_path: Path, mode: str) -> None:
    """A copy of the files in the midst of a transaction is what a SIGKILL leaves."""
    frames = make_frames(400)
    file = write_bag(tmp_path / 'bag', frames[:200], 'sqlite3')
    rest = write_bag(tmp_path / 'rest', frames[200:], 'sqlite3')
    left = tmp_path / 'left'
    left.mkdir()
    connection = sqlite3.connect(file)
    for setting in (f'journal_mode = {mode}', 'cache_size = 1', 'wal_autocheckpoint = 0'):
        connection.execute(f'PRAGMA {setting}')
    connection.execute('ATTACH ? AS rest', (str(rest),))
    copied = 'SELECT id + 200, 1, timestamp, data FROM rest.messages'
    connection.execute(f'INSERT INTO messages {copied}')
    connection.commit()
    connection.execute('DELETE FROM messages')
    for part in file.parent.glob(f'{file.name}*'):
        shutil.copy(part, left)
    connection.rollback()
    connection.close()
    before = {part: part.read_bytes() for part in left.iterdir()}
    assert before.keys() > {left / file.name}
    read, _ = read_all(left)
    assert equal(read, frames)
    assert {part: part.read_bytes() for part in left.iterdir()} == before


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


def test_control_characters_in_names_are_escaped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with FrameWriter(tmp_path / 'bag', topic='/a\x1b[2J\x07' + 'b' * 10**6) as bag:
        bag.write(make_frames(1)[0])
    assert main(['decode', str(tmp_path / 'bag')]) == 2
    said = capsys.readouterr().err
    assert '\\x1b[2J\\x07' in said
    assert '\x1b' not in said
    assert len(said) < 2000
