# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The wire keeps every frame byte for byte, every packet is counted; what a sensor is told."""

import itertools
import pickle
import struct
import time
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any

import numpy as np
import pytest
from harness_frames import (
    SENSOR_TIME_US,
    ZONES,
    content_of,
    make_frame,
    make_packets,
    read,
    reader_in_step,
    sequences,
)
from hypothesis import example, given
from hypothesis import strategies as st

from retrolidar_ros.scene.emulator import EmulatedFirmware
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.identity import Command, Commands, Identity, encode_identity
from retrolidar_ros.sensor.wire import (
    DELIMITER,
    MAX_PACKET_BYTES,
    FrameReader,
    WireCounts,
    cobs_decode,
    cobs_encode,
    crc16,
    encode_frame,
    encode_packet,
)

SEQUENCE = 0x01020304


@pytest.fixture(scope='module')
def pypi_cobs() -> Any:
    return pytest.importorskip('cobs.cobs', reason='COBS is compared with this one')


def bitwise_crc(data: bytes) -> int:
    """Return the CRC-16/CCITT-FALSE as its definition has it, bit by bit."""
    register = 0xFFFF
    for byte in data:
        register ^= byte << 8
        for _ in range(8):
            register = register << 1 ^ (0x1021 if register & 0x8000 else 0)
            register &= 0xFFFF
    return register


def joined(*pieces: bytes) -> st.SearchStrategy[bytes]:
    return st.lists(st.sampled_from(pieces), max_size=8).map(b''.join)


@given(st.binary(max_size=100))
@example(b'123456789')
def test_crc_is_the_bitwise_one(data: bytes) -> None:
    assert crc16(data) == bitwise_crc(data)
    assert bitwise_crc(b'123456789') == 0x29B1  # as published


@given(st.binary(max_size=600) | joined(b'\0', b'\1', b'\xff', b'x' * 253, b'y' * 254))
def test_cobs_equals_the_reference_on_any_data(pypi_cobs: Any, data: bytes) -> None:
    encoded = cobs_encode(data)
    assert encoded == pypi_cobs.encode(data)
    assert DELIMITER not in encoded
    assert cobs_decode(encoded) == data


@given(st.binary(max_size=8) | joined(b'\0', b'\1', b'\2', b'\3', b'\xff', b'z' * 253, b'z' * 254))
@example(b'\1')
@example(b'\3a\0')
@example(b'\xff' + b'z' * 254)
@example(b'\xff' + b'z' * 254 + b'\1')
@example(b'\xff' + b'z' * 253)
def test_cobs_decodes_or_refuses_as_the_reference_does(pypi_cobs: Any, encoded: bytes) -> None:
    try:
        expected = pypi_cobs.decode(encoded)
    except pypi_cobs.DecodeError:
        with pytest.raises(ValueError, match='COBS'):
            cobs_decode(encoded)
    else:
        assert cobs_decode(encoded) == expected


def test_a_packet_that_follows_the_protocol_is_read_and_written(pypi_cobs: Any) -> None:
    content = content_of(4, 4, ZONES, sequence=SEQUENCE)
    assert len(content) == 15 + 16 * 11
    packet = pypi_cobs.encode(content + struct.pack('<H', bitwise_crc(content))) + b'\0'
    (frame,), counts = read(packet)
    assert counts == WireCounts(frames=1)
    assert (frame.sequence, frame.sensor_time_us) == (SEQUENCE, SENSOR_TIME_US)
    assert frame.stamp_ns == SENSOR_TIME_US * 1000
    assert frame.grid == ZoneGrid(4, 4)
    assert {frame.distance.dtype, frame.signal.dtype, frame.ambient.dtype} == {np.dtype('f4')}
    assert frame.status.dtype == np.uint8
    places = [3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12]
    distance, signal, ambient, status = np.array(ZONES)[places].T
    expected = np.where(status == 255, np.nan, distance / 4000).astype(np.float32)
    np.testing.assert_array_equal(frame.distance, expected)
    np.testing.assert_array_equal(frame.signal, signal / 2048)
    np.testing.assert_array_equal(frame.ambient, ambient / 2048)
    np.testing.assert_array_equal(frame.status, status)
    assert encode_frame(frame) == packet


def test_values_are_clipped_to_the_units_of_the_wire() -> None:
    distance, light = np.ones((2, 16), np.float32)
    distance[:8] = [np.inf, 8.192, 8.19175, 0.0002, 0.0001, -0.0002, -8.192, -np.inf]
    light[:8] = [3e38, 4e6, 2097152, 2097151.5, 0.0003, 0.0002, -0.0003, -3e38]
    packet = encode_frame(make_frame(distance=distance, signal=light, ambient=light))
    zones = list(struct.iter_unpack('<hIIB', cobs_decode(packet[:-1])[15:-2]))
    in_order = [zones[n] for n in (3, 2, 1, 0, 7, 6, 5, 4)]
    assert [zone[0] for zone in in_order] == [32767, 32767, 32767, 1, 0, -1, -32768, -32768]
    highest = 2**32 - 1
    for field in (1, 2):
        raw = [highest, highest, highest, highest - 1023, 1, 0, 0, 0]
        assert [zone[field] for zone in in_order] == raw


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'distance': np.ones(15, np.float32)}, r'distance has shape \(15,\); 4x4 zones need'),
        ({'signal': np.ones((4, 4), np.float32)}, r'signal has shape \(4, 4\)'),
        ({'ambient': np.ones(64, np.float32)}, r'ambient has shape \(64,\)'),
        ({'status': np.ones(0, np.uint8)}, r'status has shape \(0,\)'),
        ({'signal': np.full(16, np.nan, np.float32)}, 'signal nan is not finite'),
        ({'ambient': np.full(16, np.inf, np.float32)}, 'ambient inf is not finite'),
        ({'distance': np.full(16, np.nan, np.float32)}, 'NaN where the status is not 255'),
        ({'sequence': 2**32}, 'sequence 4294967296 .* does not fit'),
        ({'sequence': -1}, 'sequence -1 .* does not fit'),
        ({'sensor_time_us': 2**64}, 'sensor time 18446744073709551616 µs does not fit'),
        ({'sensor_time_us': -1}, 'sensor time -1 µs does not fit'),
    ],
)
def test_frames_that_the_wire_cannot_hold(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        encode_frame(make_frame(**changes))


def ended_packets(stream: bytes) -> list[bytes]:
    """Return what stands before each delimiter, where that is not nothing."""
    return [packet for packet in stream.split(DELIMITER)[:-1] if packet]


NUMBERS = {one[:-1]: n for side in (4, 8) for n, one in enumerate(make_packets(4, side))}


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


@given(stream=garbage(), data=st.data())
def test_what_is_whole_is_read_and_all_is_counted(stream: bytes, data: st.DataObject) -> None:
    cuts = data.draw(st.lists(st.integers(0, len(stream)), max_size=20).map(sorted))
    reader = reader_in_step()
    found: list[int] = []
    for start, end in itertools.pairwise([0, *cuts, len(stream)]):
        found += sequences(reader.feed(stream[start:end]))
        assert found == [NUMBERS[one] for one in ended_packets(stream[:end]) if one in NUMBERS]
    pending = stream.rpartition(DELIMITER)[2]
    overlong = len(pending) > MAX_PACKET_BYTES  # is known before its end
    counts = reader.counts
    counted = counts.frames + counts.unknown_kind + counts.damaged
    assert counted == len(ended_packets(stream)) + overlong
    assert counts.frames == len(found)
    assert counts == read(stream)[1]


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
    ('field', 'packet'),
    [
        *(('bad_crc', packet) for packet in (b'\1', b'\2a', b'\3ab', b'\1' * MAX_PACKET_BYTES)),
        *(('bad_framing', packet) for packet in (b'\4ab', b'\xff')),
        ('overlong', b'\1' * (MAX_PACKET_BYTES + 1)),
        *(
            (field, encode_packet(content)[:-1])
            for field, content in (
                ('bad_crc', b''),
                *(('unknown_kind', one) for one in (b'\0', b'\3', content_of(4, 4, ZONES, 255))),
                *(('bad_shape', part) for part in (b'\1', b'\2', content_of(4, 4, [])[:-1])),
                *(('bad_shape', content_of(a, b, (ZONES * 16)[:count])) for a, b, count in SHAPES),
                ('bad_shape', content_of(255, 255, ZONES * 20)),
                ('bad_shape', content_of(4, 4, ZONES)[:-1]),
                ('bad_shape', content_of(4, 4, ZONES) + b'\0'),
            )
        ),
    ],
)
def test_packets_that_are_no_frames(field: str, packet: bytes) -> None:
    reader = reader_in_step()
    assert reader.feed(packet + DELIMITER) == []
    assert reader.counts == WireCounts(**{field: 1})
    assert reader.counts.damaged == (field != 'unknown_kind')
    assert sequences(reader.feed(make_packets(1)[0])) == [0]


def test_the_longest_packet_is_read_and_kept_once_and_one_byte_more_is_not() -> None:
    # COBS adds a byte and one for every 254, and the checksum has two.
    longest = b'\3' + b'x' * (MAX_PACKET_BYTES - 1 - MAX_PACKET_BYTES // 255 - 3)
    assert len(encode_packet(longest)) == MAX_PACKET_BYTES + len(DELIMITER)
    assert read(encode_packet(longest)) == ([], WireCounts(unknown_kind=1))
    assert read(encode_packet(longest + b'x')) == ([], WireCounts(overlong=1))
    reader = FrameReader()
    for length in range(1, MAX_PACKET_BYTES + 1):
        reader.feed(b'x')
        assert length < len(pickle.dumps(reader._pieces)) < length + 1000
    reader.feed(b'x')
    assert len(pickle.dumps(reader._pieces)) < 1000


RANGING = Identity('1.2.3', '000102030405060708090a0b', True)
STOPPED = RANGING._replace(is_ranging=False)
IDENTIFY, START, STOP = (one.line() for one in (Command.IDENTIFY, Command.START, Command.STOP))


def packet_of(identity: Identity) -> bytes:
    return encode_packet(encode_identity(identity))


def test_an_identity_between_frames_is_taken_and_is_no_error() -> None:
    assert encode_identity(RANGING) == bytes([2, 1, 2, 3, 1, *range(12)])  # as the protocol says
    reader = reader_in_step()
    first, second = make_packets(2)
    assert sequences(reader.feed(first + packet_of(RANGING) + second)) == [0, 1]
    assert reader.commands.identity == RANGING
    assert (reader.counts.damaged, reader.counts.unknown_kind) == (0, 0)


def test_who_is_there_is_asked_whenever_the_port_opens() -> None:
    reader = FrameReader()
    assert reader.request() == b''
    for _ in range(2):
        reader.feed(packet_of(STOPPED))  # which is to be started, but has gone before it is told
        reader.restart()
        assert reader.commands.identity is None
        assert reader.request() == IDENTIFY
        assert reader.request() == b''


def test_a_sensor_that_was_stopped_by_another_is_started_and_told_so_once() -> None:
    commands = Commands()
    commands.take(STOPPED)
    assert commands.request() == START
    commands.take(STOPPED)
    assert commands.request() == b''
    commands.take(RANGING)
    commands.take(STOPPED)
    assert commands.request() == START


def test_a_sensor_that_does_not_obey_or_answer() -> None:
    commands = Commands()
    with pytest.raises(TimeoutError, match='no answer to stop'):
        commands.ask(Command.STOP, 0.0)
    commands.restart()
    commands.request()
    commands.take(RANGING)  # another sensor, which nobody has stopped
    assert commands.request() == b''
    with ThreadPoolExecutor(1) as pool:
        for timeout_s in (0.3, 20.0):
            asked = pool.submit(commands.ask, Command.STOP, timeout_s)
            while not commands.request():
                time.sleep(0.001)
            commands.take(RANGING)
            assert not wait((asked,), 0.1).done
            if timeout_s > 1:  # one that obeys at last is not waited for any longer
                commands.take(STOPPED)
            assert asked.result(10) == (timeout_s > 1)


def test_an_emulated_sensor_obeys_lines_and_nothing_else() -> None:
    firmware, other = EmulatedFirmware('a'), EmulatedFirmware('b')
    reader = reader_in_step()

    def passed(sequence: int) -> list[tuple[int, int]]:
        frames = reader.feed(firmware.encode(make_frame(sequence=sequence)))
        return [(frame.sequence, frame.sensor_time_us) for frame in frames]

    assert passed(0) == [(0, 0)]
    assert firmware.answer(b'sto') + firmware.answer(b'p it\n\n\xff\nx' + b'stop' * 99) == b''
    assert passed(1) == [(1, 21_000)]
    reader.feed(firmware.answer(b'\nst') + firmware.answer(b'op\n'))
    identity = reader.commands.identity
    assert identity is not None
    assert not identity.is_ranging
    assert (passed(2), passed(3)) == ([], [])
    reader.feed(firmware.answer(START))
    assert reader.commands.identity == identity._replace(is_ranging=True)
    assert passed(4) == [(2, 84_000)]
    reader.feed(firmware.answer(Command.RESET.line()))
    assert [*passed(5), *passed(6)] == [(0, 0), (1, 21_000)]
    assert reader.feed(other.answer(IDENTIFY)) == []
    assert reader.commands.identity.serial != identity.serial
