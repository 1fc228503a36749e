# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Decompression of files and messages that may be damaged."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from retrolidar_ros.bag.errors import INSTALL, BagError, DamageError

MOST_BYTES = 2**28
"""So much one chunk or message may unpack to: recorders make chunks of a megabyte or so."""
_MOST_RATIO = 1000  # that a whole file may unpack to; frames unpack to ten times their size
_PIECE_BYTES = 2**16
_ZSTD = 'compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd'


def decompress_file(file: Path, plain: Path) -> DamageError | None:
    """Decompress as much of a file as can be, and as may be; return what is wrong with the rest."""
    zstd = _library(_ZSTD)
    most = max(_MOST_RATIO * file.stat().st_size, MOST_BYTES // 4)
    with zstd.open(file) as source, plain.open('wb') as target:
        try:
            while piece := source.read(_PIECE_BYTES):
                if target.tell() + len(piece) > most:
                    return DamageError(f'it unpacks to more than {most} bytes')
                target.write(piece)
        except (zstd.ZstdError, EOFError) as error:
            return DamageError(str(error))
    return None


def decompress(compression: str, data: bytes) -> bytes:
    """Return as much decompressed data as there is; DamageError for more than `MOST_BYTES`."""
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
        decompressed: bytes = decompressor.decompress(data, MOST_BYTES + 1)
    except failure as error:
        raise DamageError(f'{compression}: {error}') from error
    if len(decompressed) > MOST_BYTES:
        raise DamageError(f'{len(data)} bytes unpack to more than {MOST_BYTES}')
    return decompressed


def _library(name: str) -> Any:
    """Import a library that comes with rosbags."""
    try:
        return import_module(name)
    except ImportError as error:
        raise BagError(f'reading a compressed bag needs {name}: {INSTALL}') from error
