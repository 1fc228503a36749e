# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags that are made to harm, or that a recorder was killed over."""

import shutil
import sqlite3
from pathlib import Path

import pytest

pytest.importorskip('rosbags', reason='bags are written with rosbags')

from harness_bags import assert_good_until, equal, mcap_file, read_all, write_bag
from harness_frames import make_frames

from retrolidar_ros.bag import FRAME_TYPE, FRAMES_TOPIC, FrameWriter, messages
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


def test_what_unpacks_is_held_to_the_limit_only(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zstd = pytest.importorskip(messages._ZSTD)
    frames = make_frames(100)
    packed, file = tmp_path / 'a.mcap', tmp_path / 'b.mcap.zstd'
    packed.write_bytes(mcap_file(frames, compression='ZSTD'))
    file.write_bytes(zstd.compress(bytes(10**8)))
    for limit, path, says in (
        (500, packed, 'unpack to more than 500'),
        (4096, file, 'it unpacks to more than'),
    ):
        monkeypatch.setattr(messages, 'MAX_BYTES', limit)
        assert assert_good_until(path, frames, says) == 0


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
