# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checksum and framing of the wire against their definition and another library."""

import struct
from typing import Any

import pytest
from harness_wire import ZONES, content_of, law
from hypothesis import example, given
from hypothesis import strategies as st

from retrolidar_ros.sensor.wire import (
    DELIMITER,
    cobs_decode,
    cobs_encode,
    crc16,
)

SEQUENCE = 0x01020304
# The same as a packet, written down.
PACKET = bytes.fromhex(
    """
    0c 01 04 03 02 01 ab 89 67 45 23 01 01 05 04 04 60 f0 02 04 01 01 01 01 01 04 05 48 f4 02
    0c 01 01 02 01 01 04 06 30 f8 02 14 01 01 02 02 01 04 07 18 fc 02 1c 01 01 02 03 01 02 08
    01 01 02 24 01 01 02 04 01 04 09 e8 03 02 2c 01 01 02 05 01 02 0a 01 01 01 01 01 01 01 01
    03 01 ff 02 80 01 01 02 01 01 01 01 01 03 a0 0f 02 44 01 01 02 08 01 04 0d 88 13 02 4c 01
    01 02 09 01 04 0e 70 17 02 54 01 01 02 0a 01 04 0f 58 1b 02 5c 01 01 02 0b 01 04 10 40 1f
    02 64 01 01 02 0c 01 04 11 28 23 02 6c 01 01 02 0d 01 04 12 10 27 02 74 01 01 02 0e 01 04
    13 f8 2a 02 7c 01 01 02 0f 01 04 14 91 df 00
    """
)


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


@law
@given(st.binary(max_size=100))
@example(b'123456789')
def test_crc_is_the_bitwise_one(data: bytes) -> None:
    assert crc16(data) == bitwise_crc(data)
    assert bitwise_crc(b'123456789') == 0x29B1  # as published


@law
@given(
    st.binary(max_size=600)
    | st.lists(st.sampled_from([b'\0', b'\1', b'\xff', b'x' * 253, b'y' * 254]), max_size=8).map(
        b''.join
    )
)
def test_cobs_equals_the_reference_on_any_data(pypi_cobs: Any, data: bytes) -> None:
    encoded = cobs_encode(data)
    assert encoded == pypi_cobs.encode(data)
    assert DELIMITER not in encoded
    assert cobs_decode(encoded) == data


@pytest.mark.parametrize('filling', [b'\0', b'a', b'\xff', b'a' * 253 + b'\0', b'a' * 254 + b'\0'])
def test_cobs_equals_the_reference_at_every_length(pypi_cobs: Any, filling: bytes) -> None:
    for length in range(770):
        data = (filling * 770)[:length]
        encoded = cobs_encode(data)
        assert encoded == pypi_cobs.encode(data)
        assert len(encoded) <= length + 1 + length // 254
        assert cobs_decode(encoded) == data


@law
@given(
    st.binary(max_size=8)
    | st.lists(
        st.sampled_from([b'\0', b'\1', b'\2', b'\3', b'\xff', b'z' * 253, b'z' * 254]), max_size=6
    ).map(b''.join)
)
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


def test_the_written_packet_follows_the_protocol(pypi_cobs: Any) -> None:
    content = content_of(4, 4, ZONES, sequence=SEQUENCE)
    assert len(content) == 15 + 16 * 11
    checksum = struct.pack('<H', bitwise_crc(content))
    assert pypi_cobs.encode(content + checksum) + b'\0' == PACKET
