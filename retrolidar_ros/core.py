# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core in C: its functions and constants in `lib`, memory for them from `ffi`."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

try:
    from retrolidar_ros._core import ffi, lib
except ImportError as error:
    raise ImportError(
        f'the compiled core is missing ({error}): install a C compiler (apt install '
        'build-essential), then run colcon build, pip install . or make build'
    ) from None

__all__ = ['array', 'ffi', 'lib']

_TYPES = {
    'double': np.float64,
    'float': np.float32,
    'int64_t': np.int64,
    'uint16_t': np.uint16,
    'uint8_t': np.uint8,
}


def array(kind: str, values: ArrayLike) -> Any:
    """Return an array of C that holds values, copied only if they are laid out in another way."""
    return ffi.from_buffer(f'{kind}[]', np.ascontiguousarray(values, _TYPES[kind]))
