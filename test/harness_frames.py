# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames that no scene makes."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.sensor.frame import Floats, Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.model import Status

START_NS = 1_700_000_000 * 10**9
FRAME_PERIOD_NS = 21_000_000


def make_frames(count: int, side: int = 4, seed: int = 1) -> list[Frame]:
    """Return consecutive frames of noise, some zones without a target."""
    rng = np.random.default_rng(seed)
    shape = (count, side * side)
    distance = rng.uniform(0, 4, shape).astype(np.float32)
    distance[rng.random(shape) < 0.2] = np.nan
    light = rng.uniform(0, 500, (2, *shape)).astype(np.float32)
    status = rng.integers(0, 256, shape, dtype=np.uint8)
    return [
        Frame(
            stamp_ns=START_NS + index * FRAME_PERIOD_NS,
            sequence=index,
            sensor_time_us=index * FRAME_PERIOD_NS // 1000,
            grid=ZoneGrid(side, side),
            distance=distance[index],
            signal=light[0, index],
            ambient=light[1, index],
            status=status[index],
        )
        for index in range(count)
    ]


def recording_of(
    stamp_ns: NDArray[np.int64],
    signal: Floats,
    distance: ArrayLike = 1.0,
    status: ArrayLike = Status.VALID,
) -> Recording:
    """Return frames of 4x4 zones, whose arrays are of shape (frames, 16) or one value."""

    def each(values: ArrayLike, dtype: type) -> NDArray[Any]:
        return np.broadcast_to(values, signal.shape).astype(dtype)

    return Recording(
        stamp_ns=stamp_ns,
        sequence=np.arange(len(stamp_ns)),
        sensor_time_us=stamp_ns // 1000,
        grid=ZoneGrid(),
        distance=each(distance, np.float32),
        signal=each(signal, np.float32),
        ambient=each(0.0, np.float32),
        status=each(status, np.uint8),
    )
