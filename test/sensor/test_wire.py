# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The wire keeps every frame, as the protocol has it byte for byte."""

import struct
from typing import Any

import numpy as np
import pytest
from harness_wire import SENSOR_TIME_US, ZONES, content_of, law, make_frame, read
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from test_cobs import PACKET, SEQUENCE

from retrolidar_ros.sensor.frame import Frame, ZoneGrid
from retrolidar_ros.sensor.wire import (
    DELIMITER,
    MAX_PACKET_BYTES,
    WireCounts,
    cobs_decode,
    encode_frame,
    encode_packet,
)

both_grids = pytest.mark.parametrize('side', [4, 8])


@st.composite
def frames_of_whole_units(draw: st.DrawFn) -> Frame:
    """Return any frame that the wire holds exactly."""
    side = draw(st.sampled_from([4, 8]))
    distance, signal, ambient, status = (
        draw(hnp.arrays(dtype, side * side, elements=st.integers(lowest, highest)))
        for dtype, lowest, highest in (
            (np.int16, -(2**15), 2**15 - 1),
            (np.uint32, 0, 2**24),  # all that a float32 holds exactly
            (np.uint32, 0, 2**24),
            (np.uint8, 0, 255),
        )
    )
    return make_frame(
        side,
        sequence=draw(st.integers(0, 2**32 - 1)),
        sensor_time_us=draw(st.integers(0, 2**64 - 1)),
        distance=np.where(status == 255, np.nan, distance / 4000).astype(np.float32),
        signal=(signal / 2048).astype(np.float32),
        ambient=(ambient / 2048).astype(np.float32),
        status=status,
    )


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
    for place, number in enumerate([3, 2, 1, 0, 7, 6, 5, 4, 11, 10, 9, 8, 15, 14, 13, 12]):
        distance, signal, ambient, status = ZONES[number]
        expected = np.nan if status == 255 else np.float32(distance / 4000)
        np.testing.assert_equal(frame.distance[place], expected)
        assert frame.signal[place] == signal / 2048
        assert frame.ambient[place] == ambient / 2048
        assert frame.status[place] == status
    assert encode_frame(frame) == PACKET


@law
@given(frames_of_whole_units())
def test_whole_units_survive_the_wire_exactly(frame: Frame) -> None:
    packet = encode_frame(frame)
    assert packet.find(DELIMITER) == len(packet) - 1
    received = read_one(packet)
    assert (received.sequence, received.sensor_time_us) == (frame.sequence, frame.sensor_time_us)
    assert received.grid == frame.grid
    for name in ('distance', 'signal', 'ambient', 'status'):
        sent, got = getattr(frame, name), getattr(received, name)
        assert got.dtype == sent.dtype
        np.testing.assert_array_equal(got, sent, err_msg=name)
    assert encode_frame(received) == packet


@law
@given(
    distance=hnp.arrays(np.float32, 16, elements=st.floats(width=32)),
    light=hnp.arrays(
        np.float32, 16, elements=st.floats(width=32, allow_nan=False, allow_infinity=False)
    ),
)
def test_any_value_arrives_rounded_and_clipped(distance: Any, light: Any) -> None:
    status = np.where(np.isnan(distance), 255, 9).astype(np.uint8)
    frame = read_one(encode_frame(make_frame(distance=distance, signal=light, status=status)))
    expected = np.clip(distance.astype(float), -8.192, 8.19175)
    np.testing.assert_allclose(frame.distance, expected, rtol=1e-6, atol=0.000125)
    expected = np.clip(light.astype(float), 0, (2**32 - 1) / 2048)
    np.testing.assert_allclose(frame.signal, expected, rtol=1e-6, atol=1 / 4096)


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
