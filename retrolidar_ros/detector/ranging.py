# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How far a marker is, from one zone's samples."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from retrolidar_ros.core import ffi, lib
from retrolidar_ros.sensor.frame import Floats


class Depth(NamedTuple):
    """Of a marker, along the optical axis."""

    depth_m: float
    variance: float
    """[m²]"""
    time_s: float
    """When it holds."""


def modulated_depth(
    begin_s: Floats, end_s: Floats, light: Floats, valid: Floats, signal: Floats, distance: Floats
) -> Depth | None:
    """Return how far a marker is, as the core finds it; None without distances.

    Parameters
    ----------
    begin_s, end_s : array, shape (samples,)
        Of each exposure [s].
    light : array, shape (samples,)
        How bright the marker was, 0 to 1.
    valid : array, shape (samples,)
        Which samples are.
    signal : array, shape (samples,)
        [kcps/SPAD]
    distance : array, shape (samples,)
        [m], NaN where there was no target.
    """
    kinds = {
        'begin_s': (begin_s, 'double[]', np.float64),
        'end_s': (end_s, 'double[]', np.float64),
        'light': (light, 'double[]', np.float64),
        'valid': (valid, 'uint8_t[]', np.uint8),
        'signal': (signal, 'float[]', np.float32),
        'distance': (distance, 'float[]', np.float32),
    }
    held = {
        name: ffi.from_buffer(kind, np.ascontiguousarray(values, dtype=dtype))
        for name, (values, kind, dtype) in kinds.items()
    }
    rows = len(light)
    seen = ffi.new('struct rl_seen *', {'rows': rows, **held})
    found = ffi.new('struct rl_ranged *')
    if not lib.rl_ranging(seen, ffi.new('float[]', rows), ffi.new('uint8_t[]', rows), found):
        return None
    return Depth(found.depth_m, found.variance, found.time_s)
