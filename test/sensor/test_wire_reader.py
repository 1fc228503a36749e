# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The reader finds every whole packet in any stream of bytes, and counts all others."""

import itertools
import pickle

import pytest
from harness_wire import ZONES, content_of, law, make_packets, read, reader_in_step, sequences
from hypothesis import given, settings
from hypothesis import strategies as st

from retrolidar_ros.sensor.wire import (
    DELIMITER,
    MAX_PACKET_BYTES,
    FrameReader,
    WireCounts,
    encode_packet,
)


def counted(counts: WireCounts) -> int:
    return counts.frames + counts.unknown_kind + counts.damaged


def ended_packets(stream: bytes) -> list[bytes]:
    """Return what stands before each delimiter, where that is not nothing."""
    return [packet for packet in stream.split(DELIMITER)[:-1] if packet]


NUMBERS = {
    packet[:-1]: sequence
    for side in (4, 8)
    for sequence, packet in enumerate(make_packets(4, side))
}


def whole(stream: bytes) -> list[int]:
    """Return the sequences of the packets of `NUMBERS` that stand whole in a stream."""
    return [NUMBERS[packet] for packet in ended_packets(stream) if packet in NUMBERS]


def garbage() -> st.SearchStrategy[bytes]:
    good = st.sampled_from([*make_packets(3), *make_packets(2, side=8)])
    cut = st.tuples(good, st.integers(1, 190)).map(lambda pair: pair[0][: pair[1]])
    span, noise = st.integers(0, 30), st.binary(max_size=30)
    damaged = st.tuples(good, st.integers(0, 190), span, noise).map(
        lambda one: one[0][: one[1]] + one[3] + one[0][one[1] + one[2] :]
    )
    other = st.binary(max_size=20).map(encode_packet)
    overlong = st.integers(MAX_PACKET_BYTES - 2, MAX_PACKET_BYTES + 2).map(lambda n: n * b'\1')
    piece = good | cut | damaged | other | noise | st.just(DELIMITER) | overlong
    return st.lists(piece, max_size=10).map(b''.join)


@settings(law, max_examples=120)
@given(stream=garbage(), data=st.data())
def test_what_is_whole_is_read_and_all_is_counted(stream: bytes, data: st.DataObject) -> None:
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=20).map(sorted))
    reader = reader_in_step()
    found: list[int] = []
    for start, end in itertools.pairwise([0, *cuts, len(stream)]):
        found += sequences(reader.feed(stream[start:end]))
        assert found == whole(stream[:end])
    pending = stream.rpartition(DELIMITER)[2]
    overlong = len(pending) > MAX_PACKET_BYTES  # is known before its end
    assert counted(reader.counts) == len(ended_packets(stream)) + overlong
    assert reader.counts.frames == len(found)
    assert reader.counts == read(stream)[1]


def test_a_stream_joined_anywhere_costs_that_packet_only_and_is_no_damage() -> None:
    first, second, third = make_packets(3)
    reader = FrameReader()
    for start in range(1, len(first) - 1):
        assert sequences(reader.feed(first[start:] + second + third)) == [1, 2], start
        assert reader.counts.damaged == 0
        reader.restart()
    assert sequences(reader.feed(first + second[1:])) == [0]  # the first was whole
    assert reader.counts.damaged == 1
    assert sequences(reader.feed(second[:50])) == []
    reader.restart()
    assert reader.counts.damaged == 2  # it was begun, and cut off


# Rows, columns, and how many zones there are.
SHAPES = [(4, 4, 0), (0, 0, 0), (4, 4, 15), (8, 8, 16), (4, 4, 64), (1, 16, 16), (2, 8, 16)]
SHAPES += [(16, 1, 16), (4, 8, 32), (16, 16, 256), (255, 255, 16)]


@pytest.mark.parametrize(
    ('field', 'content'),
    [
        ('bad_crc', b''),
        *(('unknown_kind', kind) for kind in (b'\0', b'\3', content_of(4, 4, ZONES, kind=255))),
        *(('bad_shape', part) for part in (b'\1', b'\2', content_of(4, 4, [])[:-1])),
        *(
            ('bad_shape', content_of(rows, columns, (ZONES * 16)[:zones]))
            for rows, columns, zones in SHAPES
        ),
        ('bad_shape', content_of(255, 255, ZONES * 20)),
        ('bad_shape', content_of(4, 4, ZONES)[:-1]),
        ('bad_shape', content_of(4, 4, ZONES) + b'\0'),
    ],
)
def test_whole_packets_that_are_no_frames(field: str, content: bytes) -> None:
    reader = reader_in_step()
    assert reader.feed(encode_packet(content)) == []
    assert reader.counts == WireCounts(**{field: 1})
    assert reader.counts.damaged == (field != 'unknown_kind')
    assert sequences(reader.feed(make_packets(1)[0])) == [0]


@pytest.mark.parametrize(
    ('field', 'packet'),
    [
        *(('bad_crc', packet) for packet in (b'\1', b'\2a', b'\3ab', b'\1' * MAX_PACKET_BYTES)),
        *(('bad_framing', packet) for packet in (b'\4ab', b'\xff')),
        ('overlong', b'\1' * (MAX_PACKET_BYTES + 1)),
    ],
)
def test_packets_that_are_not_whole(field: str, packet: bytes) -> None:
    counts = WireCounts(**{field: 1})
    assert read(packet + DELIMITER) == ([], counts)
    assert counts.damaged == 1


def test_the_longest_packet_is_read_and_kept_once_and_one_byte_more_is_not() -> None:
    # COBS adds a byte and one for every 254, and the checksum has two.
    longest = b'\3' + b'x' * (MAX_PACKET_BYTES - 1 - MAX_PACKET_BYTES // 255 - 3)
    assert len(encode_packet(longest)) == MAX_PACKET_BYTES + len(DELIMITER)
    assert read(encode_packet(longest)) == ([], WireCounts(unknown_kind=1))
    assert read(encode_packet(longest + b'x')) == ([], WireCounts(overlong=1))
    reader = FrameReader()
    for length in range(1, MAX_PACKET_BYTES + 1):
        reader.feed(b'x')
        assert length < len(pickle.dumps(reader._packets)) < length + 1000
    reader.feed(b'x')
    assert len(pickle.dumps(reader._packets)) < 1000
