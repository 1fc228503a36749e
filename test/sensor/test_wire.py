# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The wire keeps every frame, as the protocol has it byte for byte."""

import struct
from typing import Any

import numpy as np
import pytest
from harness_wire import SENSOR_TIME_US, ZONES, content_of, make_frame, read
from test_cobs import PACKET, SEQUENCE

from retrolidar_ros.sensor.frame import Frame, ZoneGrid
from retrolidar_ros.sensor.wire import (
    MAX_PACKET_BYTES,
    WireCounts,
    cobs_decode,
    encode_frame,
    encode_packet,
)

both_grids = pytest.mark.parametrize('side', [4, 8])


def read_one(packet: bytes) -> Frame:
    """Read a packet that holds a frame."""
    (frame,), counts = read(packet)
    assert counts == WireCounts(frames=1)
    return frame


def test_the_written_packet_is_read_and_written_byte_for_byte() -> None:
    frame = read_one(PACKET)
    assert (frame.sequence, frame.sensor_time_us) == (SEQUENCE, SENSOR_TIME_US)
    assert frame.stamp_ns == SENSOR_TIME_US * 1000
    assert frame.grid == ZoneGrid(4, 4)
    assert {frame.distance.dtype, frame.signal.dtype, frame.ambient.dtype} == {np.dtype('f4')}
    assert frame.status.dtype == np.uint8
    for place, number in enumerate([3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12]):
        distance, signal, ambient, status = ZONES[number]
        expected = np.nan if status == 255 else np.float32(distance / 4000)
        np.testing.assert_equal(frame.distance[place], expected)
        assert frame.signal[place] == signal / 2048
        assert frame.ambient[place] == ambient / 2048
        assert frame.status[place] == status
    assert encode_frame(frame) == PACKET


def test_values_are_clipped_to_the_units_of_the_wire() -> None:
    distance = np.full(16, 1.0, np.float32)
    light = np.full(16, 1.0, np.float32)
    distance[:8] = [np.inf, 8.192, 8.19175, 0.0002, 0.0001, -0.0002, -8.192, -np.inf]
    light[:8] = [3e38, 4e6, 2097152, 2097151.5, 0.0003, 0.0002, -0.0003, -3e38]
    packet = encode_frame(make_frame(distance=distance, signal=light, ambient=light))
    zones = list(struct.iter_unpack('<hIIB', cobs_decode(packet[:-1])[15:-2]))
    in_order = [zones[n] for n in (3, 2, 1, 0, 7, 6, 5, 4)]
    assert [zone[0] for zone in in_order] == [32767, 32767, 32767, 1, 0, -1, -32768, -32768]
    for field in (1, 2):
        highest = 2**32 - 1
        raw = [highest, highest, highest, highest - 1023, 1, 0, 0, 0]
        assert [zone[field] for zone in in_order] == raw


@both_grids
def test_only_status_255_means_no_distance_and_rows_begin_at_the_right(side: int) -> None:
    for first in range(0, 256, side**2):
        status = np.arange(first, first + side**2)
        zones = [(8000, 2048, 0, int(code)) for code in status]
        frame = read_one(encode_packet(content_of(side, side, zones)))
        np.testing.assert_array_equal(frame.status.reshape(side, side)[:, ::-1].ravel(), status)
        np.testing.assert_array_equal(np.isnan(frame.distance), frame.status == 255)
        assert (frame.distance[frame.status != 255] == 2).all()


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


@both_grids
def test_a_packet_at_its_longest_is_far_from_the_limit(side: int) -> None:
    zones = [(-1, 2**32 - 1, 2**32 - 1, 254)] * side**2
    packet = encode_packet(content_of(side, side, zones))
    assert len(packet) == {4: 195, 8: 725}[side]
    assert len(packet) < MAX_PACKET_BYTES / 5
