# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames in serialized messages, compression, and errors of bags."""

import struct
import sys
from importlib import import_module
from pathlib import Path
from struct import Struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.sensor.frame import GRIDS, Frame

INSTALL = 'pip install rosbags (on Ubuntu 24.04: --user --break-system-packages)'


class BagError(ValueError):
    """A bag cannot be written, or cannot be read to its end."""


class DamageError(Exception):
    """A file is damaged; the frames before the damage are good."""


MAX_BYTES = 2**28  # of an unpacked chunk or message; recorders make chunks of a megabyte or so
_MAX_RATIO = 1000  # of the sizes of a file unpacked and packed; that of frames is ten
_PIECE_BYTES = 2**16
_ZSTD = 'compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd'


def decompress_file(file: Path, plain: Path) -> DamageError | None:
    """Decompress as much of a file as can be, and as may be; return what is wrong with the rest."""
    zstd = _library(_ZSTD)
    max_bytes = max(_MAX_RATIO * file.stat().st_size, MAX_BYTES // 4)
    with zstd.open(file) as source, plain.open('wb') as target:
        try:
            while piece := source.read(_PIECE_BYTES):
                if target.tell() + len(piece) > max_bytes:
                    return DamageError(f'it unpacks to more than {max_bytes} bytes')
                target.write(piece)
        except (zstd.ZstdError, EOFError) as error:
            return DamageError(str(error))
    return None


def decompress(compression: str, data: bytes) -> bytes:
    """Return as much decompressed data as there is; DamageError for more than `MAX_BYTES`."""
    if compression == '':
        return data
    if compression == 'zstd':
        zstd = _library(_ZSTD)
        decompressor, failure = zstd.ZstdDecompressor(), zstd.ZstdError
    elif compression == 'lz4':
        decompressor, failure = _library('lz4.frame').LZ4FrameDecompressor(), RuntimeError
    else:
        raise DamageError(f'unknown compression {compression!r}')
    try:
        decompressed: bytes = decompressor.decompress(data, MAX_BYTES + 1)
    except failure as error:
        raise DamageError(f'{compression}: {error}') from error
    if len(decompressed) > MAX_BYTES:
        raise DamageError(f'{len(data)} bytes unpack to more than {MAX_BYTES}')
    return decompressed


def _library(name: str) -> Any:
    """Import a library that comes with rosbags."""
    try:
        return import_module(name)
    except ImportError as error:
        raise BagError(f'reading a compressed bag needs {name}: {INSTALL}') from error


FRAME_TYPE = 'retrolidar_ros/msg/Frame'

_CDR_LITTLE_ENDIAN = b'\0\1\0\0'  # fields are aligned from its end
_STAMP = Struct('<iII')  # seconds, nanoseconds, and the length of the frame_id that follows
_SENSOR = Struct('<QBB')  # sensor time, rows, columns
_UINT32 = Struct('<I')
ARRAYS = (
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
        grid = GRIDS.get((rows, columns))
        if grid is None:
            raise DamageError(f'a frame of {rows}x{columns} zones')
        position += (_SENSOR.size + 3) & -4
        arrays: list[NDArray[Any]] = []
        for name, dtype in ARRAYS:
            (length,) = _UINT32.unpack_from(data, position)
            if length != grid.zones:
                raise DamageError(f'{name} has {length} values for {rows}x{columns} zones')
            position += _UINT32.size
            arrays.append(np.frombuffer(data, dtype, length, position))
            position += length * dtype.itemsize
    except (struct.error, ValueError) as error:
        raise DamageError(f'a message ends early, after {len(data)} bytes') from error
    return Frame(seconds * 10**9 + nanoseconds, sequence, sensor_time_us, grid, *arrays)
