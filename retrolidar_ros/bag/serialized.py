# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Serialized messages to frames."""

from __future__ import annotations

import struct
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.bag.errors import DamageError
from retrolidar_ros.sensor.frame import ZONE_SHAPES, Frame, ZoneGrid

FRAME_TYPE = 'retrolidar_ros/msg/Frame'

_CDR_LITTLE_ENDIAN = b'\0\1\0\0'  # fields are aligned from its end
_STAMP = Struct('<iII')  # seconds, nanoseconds, and the length of the frame_id that follows
_SENSOR = Struct('<QBB')  # sensor time, rows, columns
_UINT32 = Struct('<I')
_GRIDS = {shape: ZoneGrid(*shape) for shape in ZONE_SHAPES}
_ARRAYS = (
    ('distance', np.dtype('<f4')),
    ('signal', np.dtype('<f4')),
    ('ambient', np.dtype('<f4')),
    ('status', np.dtype('u1')),
)


def decode_frame(data: bytes) -> Frame:
    """Return the frame in a serialized message; DamageError if there is none."""
    origin = len(_CDR_LITTLE_ENDIAN)
    if data[:origin] != _CDR_LITTLE_ENDIAN:
        raise DamageError(f'a message starts with {data[:origin]!r}, not as little-endian CDR')
    try:
        seconds, nanoseconds, length = _STAMP.unpack_from(data, origin)
        position = origin + ((_STAMP.size + length + 3) & -4)
        (sequence,) = _UINT32.unpack_from(data, position)
        position = origin + ((position - origin + _UINT32.size + 7) & -8)
        sensor_time_us, rows, columns = _SENSOR.unpack_from(data, position)
        grid = _GRIDS.get((rows, columns))
        if grid is None:
            raise DamageError(f'a frame of {rows}x{columns} zones')
        position += (_SENSOR.size + 3) & -4
        arrays: list[NDArray[Any]] = []
        for name, dtype in _ARRAYS:
            (length,) = _UINT32.unpack_from(data, position)
            if length != grid.zones:
                raise DamageError(f'{name} has {length} values for {rows}x{columns} zones')
            position += _UINT32.size
            arrays.append(np.frombuffer(data, dtype, length, position))
            position += length * dtype.itemsize
    except (struct.error, ValueError) as error:
        raise DamageError(f'a message ends early, after {len(data)} bytes') from error
    return Frame(seconds * 10**9 + nanoseconds, sequence, sensor_time_us, grid, *arrays)
