# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Decompression of files and messages that may be damaged."""

from __future__ import annotations

import shutil
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

from retrolidar_ros.bag.errors import INSTALL, BagError, DamageError

_ZSTD = 'compression.zstd' if sys.version_info >= (3, 14) else 'backports.zstd'


def decompress_file(file: Path, plain: Path) -> DamageError | None:
    """Decompress a file up to its damage; return the damage, if any."""
    zstd = _library(_ZSTD)
    with zstd.open(file) as source, plain.open('wb') as target:
        try:
            shutil.copyfileobj(source, target)
        except (zstd.ZstdError, EOFError) as error:
            return DamageError(str(error))
    return None


def decompress(compression: str, data: bytes) -> bytes:
    """Return the decompressed data, up to its damage."""
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
        decompressed: bytes = decompressor.decompress(data)
    except failure as error:
        raise DamageError(f'{compression}: {error}') from error
    return decompressed


def _library(name: str) -> Any:
    """Import a library that comes with rosbags."""
    try:
        return import_module(name)
    except ImportError as error:
        raise BagError(f'reading a compressed bag needs {name}: {INSTALL}') from error
