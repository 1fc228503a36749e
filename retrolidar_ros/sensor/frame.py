# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames of distance, signal, ambient and status of every zone, and the zones' angles.

Zones are numbered row-major, row 0 at the top and column 0 at the left of the scene as seen
from the sensor. Directions are in the optical frame: x right, y down, z forward.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.sensor.model import VL53L8CX

Floats: TypeAlias = NDArray[np.floating]

IS_NORMAL: NDArray[np.bool_] = np.isin(np.arange(256), VL53L8CX.valid)  # by status
_SHAPES = ((4, 4), (8, 8))  # rows, columns; the core takes 64 zones at most
_COUNTER = 2**32
FRAMES_A_BIT = (0.95, 9.0)  # how many frames a bit lasts at least and at most, if it is to be read
_JUDGED_FRAMES = 10
_MIN_PERIOD_NS = 1_000_000


def valid_samples(
    signal: Floats, distance: Floats, status: NDArray[np.uint8]
) -> tuple[NDArray[np.bool_], int]:
    """Return which samples (...) are valid, and how many have a valid status but impossible values.

    The others are erasures.
    """
    normal: NDArray[np.bool_] = IS_NORMAL[status]
    # Comparisons with NaN are false: a NaN signal is an erasure, a NaN distance is no target.
    possible = (signal >= 0) & (signal <= VL53L8CX.max_signal)
    possible &= ((distance > 0) & (distance < VL53L8CX.max_distance_m)) | np.isnan(distance)
    return normal & possible, int(np.count_nonzero(normal & ~possible))


@dataclass(frozen=True)
class ZoneGrid:
    """The directions of a VL53L8CX's zones, equal steps of a tangent: flat at any distance."""

    rows: int = 4
    columns: int = 4
    view: float = field(default=VL53L8CX.field_of_view, compare=False)
    """Width of all zones together, in tangents; it differs a little from lens to lens."""

    def __post_init__(self) -> None:
        """Raise ValueError for a shape that the sensor does not have."""
        if (self.rows, self.columns) not in _SHAPES:
            raise ValueError(f'{self.rows}x{self.columns} zones: the sensor has 4x4 or 8x8')

    @property
    def zones(self) -> int:
        """Number of zones."""
        return self.rows * self.columns

    @property
    def pitch(self) -> float:
        """Width and height of a zone, as a tangent."""
        return self.view / self.columns

    @cached_property
    def tangents(self) -> Floats:
        """Centre of each zone as (x/z, y/z), shape (zones, 2)."""
        row, column = np.divmod(np.arange(self.zones), self.columns)
        steps = [column - (self.columns - 1) / 2, row - (self.rows - 1) / 2]
        return self.pitch * np.stack(steps, axis=-1)

    @cached_property
    def directions(self) -> Floats:
        """Unit vector to the centre of each zone, shape (zones, 3)."""
        rays = np.concatenate([self.tangents, np.ones((self.zones, 1))], axis=-1)
        directions: Floats = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        return directions

    @cached_property
    def near(self) -> NDArray[np.bool_]:
        """Which zones are the same or neighbours, shape (zones, zones)."""
        place = np.stack(np.divmod(np.arange(self.zones), self.columns))
        near: NDArray[np.bool_] = np.abs(place[:, :, None] - place[:, None]).max(axis=0) <= 1
        return near

    @cached_property
    def z_per_range(self) -> Floats:
        """Reported distance over radial range of each zone, shape (zones,).

        The sensor turns the radial range of a target into a distance along the optical axis by one
        factor a zone, wherever in it the target is: that which makes the mean range of a flat wall,
        the mean secant over the zone, its depth.
        """
        steps = (np.arange(16) + 0.5) / 16 - 0.5
        across, down = np.meshgrid(self.pitch * steps, self.pitch * steps)
        x = self.tangents[:, 0, None] + across.ravel()
        y = self.tangents[:, 1, None] + down.ravel()
        mean_secant: Floats = np.sqrt(1 + x * x + y * y).mean(axis=-1)
        return 1 / mean_secant


GRIDS = {shape: ZoneGrid(*shape) for shape in _SHAPES}  # the usual grid of each shape


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame: (D, I, A, S) of paper §2.1 for every zone, shape (zones,), as in the scene."""

    stamp_ns: int  # middle of the exposure [ns]: by the sensor's clock until a driver maps it
    sequence: int  # the sensor's frame counter, 32 bits; a jump means lost frames
    sensor_time_us: int  # the sensor's clock at the middle of the exposure [µs]
    grid: ZoneGrid
    distance: NDArray[np.float32]  # along the optical axis [m]; NaN where there is no target
    signal: NDArray[np.float32]  # received signal [kcps/SPAD]
    ambient: NDArray[np.float32]  # ambient light [kcps/SPAD]
    status: NDArray[np.uint8]  # the sensor's target status codes, see `Status`

    def check(self) -> None:
        """Raise ValueError naming the first array that does not hold one value a zone."""
        grid = self.grid
        for name in ('distance', 'signal', 'ambient', 'status'):
            if (shape := np.shape(getattr(self, name))) != (grid.zones,):
                raise ValueError(
                    f'{name} has shape {shape}; {grid.rows}x{grid.columns} zones need '
                    f'({grid.zones},)'
                )


@dataclass(frozen=True, eq=False)
class Recording:
    """Consecutive frames of one sensor, stacked: the arrays have a leading time axis."""

    stamp_ns: NDArray[np.int64]
    sequence: NDArray[np.int64]
    sensor_time_us: NDArray[np.int64]
    grid: ZoneGrid
    distance: NDArray[np.float32]
    signal: NDArray[np.float32]
    ambient: NDArray[np.float32]
    status: NDArray[np.uint8]

    @classmethod
    def of(cls, frames: list[Frame]) -> Recording:
        """Stack frames; ValueError if there are none, or their zone grids differ."""
        if not frames:
            raise ValueError('a recording needs at least one frame')
        grid = frames[0].grid
        if any(frame.grid is not grid and frame.grid != grid for frame in frames):
            raise ValueError('the frames have different zone grids')
        arrays: dict[str, NDArray[Any]] = {}
        for name in vars(frames[0]).keys() - {'grid'}:
            values = [getattr(frame, name) for frame in frames]
            # With its type; to be found it takes three times as long.
            arrays[name] = np.array(values, np.asarray(values[0]).dtype)
        return cls(grid=grid, **arrays)

    def newest(self, count: int) -> Recording:
        """Return the last frames, so many at most."""
        arrays = {name: value[-count:] for name, value in vars(self).items() if name != 'grid'}
        return replace(self, **arrays)

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.stamp_ns)

    def __iter__(self) -> Iterator[Frame]:
        """Go through the frames in order of time."""
        times = self.stamp_ns.tolist(), self.sequence.tolist(), self.sensor_time_us.tolist()
        arrays = self.distance, self.signal, self.ambient, self.status
        for stamp_ns, sequence, time_us, *values in zip(*times, *arrays, strict=True):
            yield Frame(stamp_ns, sequence, time_us, self.grid, *values)


def missing_frames(before: int | None, after: int) -> int:
    """Return how many frames are missing between two 32-bit sequence counters.

    Before the first frame there is None. A counter that went back is a sensor that restarted.
    """
    if before is None:
        return 0
    missing = (after - before - 1) % _COUNTER
    return missing if missing < _COUNTER // 2 else 0


def stamps_stand(frames: int, advance_ns: int) -> bool:
    """Return whether the stamps of so many frames, which advanced by so much, stand still."""
    return frames >= _JUDGED_FRAMES and abs(advance_ns) < frames * _MIN_PERIOD_NS


def frame_period(recording: Recording) -> float:
    """Return the usual time between successive frames [s], of which some may be lost; NaN of one.

    By the later of stamp and sensor's clock: stamps of frames that come late, all at once, are too
    near to each other.
    """
    if len(recording) < 2:
        return math.nan
    step_ns = np.maximum(np.diff(recording.stamp_ns), 1000 * np.diff(recording.sensor_time_us))
    numbers = recording.sequence.tolist()
    missing = np.array([missing_frames(*pair) for pair in pairwise(numbers)])
    return float(np.median(step_ns / (1 + missing))) * 1e-9
