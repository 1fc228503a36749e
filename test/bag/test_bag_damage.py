# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Damaged and harmful bags give their frames up to the damage, and an error that names it."""

import os
import random
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from harness_bags import (
    FRAME_ID,
    SUFFIXES,
    Storage,
    assert_good_until,
    bits,
    both_storages,
    equal,
    mcap_file,
    message,
    read_all,
    serialized,
    type_store,
    write_bag,
    write_messages,
)
from harness_frames import make_frames

from retrolidar_ros.bag import (
    FRAME_TYPE,
    FRAMES_TOPIC,
    BagError,
    FrameWriter,
    messages,
    read_frames,
)
from retrolidar_ros.cli.main import main

CUT = r'is empty|not an SQLite file|ends at byte {}\b|record at byte \d+: (damaged|a .* is cut off)'
ZEROS = 'not an|no whole record|is cut off|is malformed|table lacks messages|x. zones|little-endian'


@both_storages
@pytest.mark.parametrize('filling', [b'', b'\0'], ids=['cut', 'zeros'])
def test_files_are_read_to_where_they_are_cut_or_filled_with_zeros(
    tmp_path: Path, storage: Storage, filling: bytes
) -> None:
    """File systems leave either after a power cut."""
    frames = make_frames(300)
    whole = write_bag(tmp_path / 'bag', frames, storage).read_bytes()
    cut = tmp_path / f'cut{SUFFIXES[storage]}'
    places = random.Random(2).sample(range(len(whole) - 37), 15)
    counts = []
    for size in sorted([*places, 0, 1, 8, 9, 100, len(whole) - 37]):
        cut.write_bytes(whole[:size] + filling * (len(whole) - size))
        counts.append(assert_good_until(cut, frames, ZEROS if filling else CUT.format(size)))
        in_file = whole[:size].count(FRAME_ID)
        assert in_file - counts[-1] <= (1 if storage == 'mcap' else 20)  # a page of a database
    assert counts == sorted(counts)
    if storage == 'mcap':
        says = f'{"no whole record at" if filling else "the file ends at"} byte {size}'
        assert assert_good_until(cut, frames, says) == len(frames)


def execute(file: Path, *statements: str) -> list[Any]:
    """Change a database; return the rows of the last statement."""
    with closing(sqlite3.connect(file)) as connection:
        rows = [connection.execute(statement).fetchall() for statement in statements]
        connection.commit()
    return rows[-1]


def test_a_database_is_read_without_its_index(tmp_path: Path) -> None:
    frames = make_frames(400)
    file = write_bag(tmp_path / 'bag', frames, 'sqlite3')
    ((root,),) = execute(file, "SELECT rootpage FROM sqlite_master WHERE name = 'timestamp_idx'")
    data = bytearray(file.read_bytes())
    data[4096 * (root - 1) : 4096 * root] = bytes(4096)
    file.write_bytes(data)
    assert assert_good_until(file, frames, 'malformed') == len(frames)


@pytest.mark.parametrize(
    ('storage', 'compression'), [('mcap', 'STORAGE'), ('mcap', 'FILE'), ('sqlite3', 'FILE')]
)
def test_truncated_compression(tmp_path: Path, storage: Storage, compression: str) -> None:
    frames = make_frames(2000, side=8)
    write_messages(tmp_path / 'bag', serialized(frames), storage, compression)
    end = '.zstd' if compression == 'FILE' else ''
    file = tmp_path / 'bag' / f'bag{SUFFIXES[storage]}{end}'
    file.write_bytes(file.read_bytes()[: file.stat().st_size // (2 if end else 3)])
    says = 'ended before the end' if end else r'record at byte \d+: a record inside is cut off'
    assert assert_good_until(file, frames, says) > len(frames) // 4
    if end:
        file.write_bytes(b'not zstd')
        assert assert_good_until(file, frames, 'Unable to decompress') == 0


@pytest.mark.parametrize('page', [512, 65536])
def test_a_lost_end_is_reported_though_no_frame_was_in_it(tmp_path: Path, page: int) -> None:
    frames = make_frames(20)
    file = write_bag(tmp_path / 'bag', frames, 'sqlite3')
    appendix = 'CREATE TABLE appendix AS SELECT zeroblob(200000)'
    execute(file, f'PRAGMA page_size = {page}', 'VACUUM', appendix)
    data = file.read_bytes()
    file.write_bytes(data[:-page])
    says = f'ends at byte {len(data) - page} of {len(data)}'
    assert assert_good_until(file, frames, says) == len(frames)


@pytest.mark.parametrize('compression', ['NONE', 'LZ4', 'ZSTD'])
def test_a_damaged_chunk_ends_the_frames(tmp_path: Path, compression: str) -> None:
    frames, file = make_frames(200), tmp_path / 'a.mcap'
    whole = mcap_file(frames, compression=compression)
    first = 17 + int.from_bytes(whole[9:17], 'little')
    assert whole[first] == 6
    # Somewhere in a chunk, and in the uncompressed size of the first.
    for place, where, least, most in ((len(whole) // 2, '', 81, 100), (first + 25, first, 0, 20)):
        data = bytearray(whole)
        data[place] ^= 0x10
        file.write_bytes(data)
        assert least <= assert_good_until(file, frames, f'the record at byte {where}') <= most


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
    for content in (b'', text[:97], bytes(200), b'\xff\xfe', b'- 1', b'text', b'a: {'):
        metadata.write_bytes(content)
        assert assert_good_until(tmp_path / 'bag', frames, 'metadata.yaml is damaged') == 20
    metadata.unlink()
    assert assert_good_until(tmp_path / 'bag', frames, 'no metadata.yaml') == 20
    # A pipe, a device and a directory in its place are not opened.
    for make in (os.mkfifo, lambda path: path.symlink_to('/dev/zero'), Path.mkdir):
        make(metadata)
        assert assert_good_until(tmp_path / 'bag', frames, 'metadata.yaml is no file') == 20
        metadata.rmdir() if metadata.is_dir() else metadata.unlink()


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


@both_storages
def test_a_wrong_topic_is_refused(tmp_path: Path, storage: Storage) -> None:
    messages = serialized(make_frames(2))
    write_messages(tmp_path / 'bag', messages, storage, topic='/left/frames')
    write_bag(tmp_path / 'empty', [], storage)
    assert len(list(read_frames(tmp_path / 'bag', '/left/frames'))) == 2
    there = r'.*/left/frames \(retrolidar_ros/msg/Frame\).*'
    missing = rf'no topic {FRAMES_TOPIC}(?={there})(?=.*/other \(std_msgs/msg/Header)'
    for bag, topic, text in (
        ('bag', FRAMES_TOPIC, missing),
        ('bag', '/other', f'/other is of type std_msgs/msg/Header, not {FRAME_TYPE}'),
        ('empty', FRAMES_TOPIC, f'{FRAMES_TOPIC} has no frames'),
    ):
        with pytest.raises(BagError, match=text):
            next(read_frames(tmp_path / bag, topic))


def test_messages_that_are_no_frames(tmp_path: Path) -> None:
    frames = make_frames(4)
    *messages, (time, data) = serialized(frames)
    wrongs: list[tuple[str, dict[str, Any]]] = [
        ('distance has 15 values for 4x4 zones', {'distance': np.zeros(15, np.float32)}),
        ('ambient has 64 values for 4x4 zones', {'ambient': np.zeros(64, np.float32)}),
        ('status has 0 values for 4x4 zones', {'status': np.zeros(0, np.uint8)}),
        ('a frame of 3x4 zones', {'rows': 3}),
    ]
    cases = [
        (says, type_store().serialize_cdr(message(frames[3], **changes), FRAME_TYPE))
        for says, changes in wrongs
    ]
    big_endian = type_store().serialize_cdr(message(frames[3]), FRAME_TYPE, little_endian=False)
    cases += [
        ('a message', wrong) for wrong in [big_endian, *(data[:n] for n in range(0, len(data), 19))]
    ]
    for index, (says, wrong) in enumerate(cases):
        path = tmp_path / f'bag_{index}'
        write_messages(path, [*messages, (time, wrong)])
        assert assert_good_until(path, frames, says) == 3


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


def test_what_unpacks_is_held_to_the_limit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    zstd = pytest.importorskip(messages._ZSTD)
    frames = make_frames(100)
    packed, file = tmp_path / 'a.mcap', tmp_path / 'b.mcap.zstd'
    packed.write_bytes(mcap_file(frames, compression='ZSTD'))
    file.write_bytes(zstd.compress(bytes(10**8)))
    for limit, path, says in ((500, packed, '500'), (4096, file, r'\d+ bytes')):
        monkeypatch.setattr(messages, 'MAX_BYTES', limit)
        assert assert_good_until(path, frames, f'to more than {says}') == 0


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


def test_control_characters_are_escaped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with FrameWriter(tmp_path / 'bag', topic='/a\x1b[2J\x07' + 'b' * 10**6) as bag:
        bag.write(make_frames(1)[0])
    assert main(['decode', str(tmp_path / 'bag')]) == 2
    said = capsys.readouterr().err
    assert '\\x1b[2J\\x07' in said
    assert '\x1b' not in said
    assert len(said) < 2000
