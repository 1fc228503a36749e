# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The core in C: its functions and constants in `lib`, memory for them from `ffi`."""

try:
    from retrolidar_ros._core import ffi, lib
except ImportError as error:
    raise ImportError(
        f'the compiled core is missing ({error}): install a C compiler (apt install '
        'build-essential), then run colcon build, pip install . or make build'
    ) from None

__all__ = ['ffi', 'lib']
