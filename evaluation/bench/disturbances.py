# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenes without a marker that may be taken for one: the family before which budgets hold.

Each member yields blocks of frames that follow each other. Signals that walk do so where the
sensor's noise is one everywhere: in the square root of the signal, so that a step is a share of
the noise at every level. All of it is computed block by block, for all zones at once.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.restless import LEAST_SIGNAL, MOST_SIGNAL, Hands
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats, Recording, Status

BLOCK_FRAMES = 4096
PRESENT_SIGNALS, BLINKING_SIGNAL = (5.0, 1000.0), 100.0
PRESENT_S = (0.1, 3.0)
_NEAR_M, _NEAR_SIGNAL, _FAR_M = 0.2, 1700.0, 6.0  # distances follow the square root of signals
_NOTHING_BEHIND = 0.3  # share of the absences in which there is no wall either
_MERGED = 0.1  # share of what appears that is reported as merged

Singles = NDArray[np.float32]
Codes = NDArray[np.uint8]


class Source(Protocol):
    """One kind of scene, as it goes on."""

    def advance(self, frames: int) -> tuple[Singles, Codes | None]:
        """Return the next signals without noise [kcps/SPAD], and statuses unless all are valid.

        Both are of shape (frames, zones); where there is no target the signal does not count.
        """


class Member(NamedTuple):
    """One member of the family."""

    name: str
    blocks: Callable[[float, np.random.Generator, Sensor], Iterator[Recording]]
    """Yields the frames of a duration [s]."""
    blinks: bool = False
    """Whether it has the bit clock: the rate of false IDs is reported, and not held to a budget."""


def _log_uniform(bounds: tuple[float, float], size: int, rng: np.random.Generator) -> Floats:
    low, high = np.log(bounds)
    values: Floats = np.exp(rng.uniform(low, high, size))
    return values


class White:
    """Noise alone, in every zone at another level."""

    def __init__(
        self, sensor: Sensor, rng: Any, signals: tuple[float, float] = (4.0, 600.0)
    ) -> None:
        levels = np.geomspace(*signals, sensor.grid.zones, dtype=np.float32)
        self._levels = rng.permutation(levels)

    def advance(self, frames: int) -> tuple[Singles, None]:
        """Return the levels again and again."""
        return np.tile(self._levels, (frames, 1)), None


def _scaled(signal: float) -> float:
    """Return a signal [kcps/SPAD] on the scale on which the sensor's noise is one."""
    return 2 / NOISE.slope * math.sqrt(NOISE.floor + NOISE.slope * signal)


class Walk:
    """Signals that walk between bounds, in steps of a share of the noise."""

    def __init__(self, sensor: Sensor, rng: Any, *, step: float, heavy: bool = False) -> None:
        self._rng, self._step, self._heavy = rng, step, heavy
        self._low, self._high = _scaled(LEAST_SIGNAL), _scaled(MOST_SIGNAL)
        self._last = rng.uniform(self._low, self._high, sensor.grid.zones)

    def advance(self, frames: int) -> tuple[Singles, None]:
        """Return the next signals; heavy-tailed steps are of Student's t with two degrees."""
        shape = (frames, len(self._last))
        steps = self._rng.standard_normal(shape, dtype=np.float32)
        if self._heavy:
            steps /= np.sqrt(self._rng.standard_exponential(shape, dtype=np.float32))
        walked = self._last + np.cumsum(self._step * steps, axis=0, dtype=np.float64)
        width = self._high - self._low
        walked = self._high - np.abs((walked - self._low) % (2 * width) - width)
        self._last = walked[-1]
        scaled = (NOISE.slope / 2 * walked).astype(np.float32)
        return (scaled * scaled - np.float32(NOISE.floor)) / np.float32(NOISE.slope), None


def _held(
    values: Floats, edges: Floats, frames: int
) -> tuple[Singles, NDArray[np.intp], NDArray[np.bool_]]:
    """Return the mean over each frame of values that are held between edges.

    The n + 1 edges are in frames from the beginning, ascending, from 0 or before to the last frame
    or beyond. Also returned are which value each frame ends with, and whether that began within it.
    """
    sums = np.concatenate([[0.0], np.cumsum(values * np.diff(edges))])
    times = np.arange(frames + 1)
    means = np.diff(np.interp(times, edges, sums)).astype(np.float32)
    place = np.searchsorted(edges, times[1:], side='left') - 1
    return means, place, edges[place] > times[:-1]


class Targets:
    """Targets that come and go, with levels and durations of their own, before a wall or none."""

    def __init__(self, sensor: Sensor, rng: Any, *, together: bool = False) -> None:
        self._zones, self._rng, self._together = sensor.grid.zones, rng, together
        self._period_s = sensor.period_s

    def _course(self, frames: int) -> tuple[Singles, Codes]:
        """Return signals and statuses of one zone, shape (frames,)."""
        rng = self._rng
        turns = 2 + int(frames * self._period_s / PRESENT_S[0])
        lasting = _log_uniform(PRESENT_S, turns, rng) / self._period_s
        edges = np.concatenate([[0.0], np.cumsum(lasting)]) - lasting[0] * rng.random()
        turns = int(np.searchsorted(edges, frames))
        levels = _log_uniform(PRESENT_SIGNALS, turns, rng)
        codes = np.where(rng.random(turns) < _MERGED, Status.MERGED, Status.VALID)
        # Every second is absent, so that what comes has another neighbour than what goes.
        absent = np.arange(turns) % 2 == rng.integers(2)
        levels[absent] = WALL_SIGNAL
        codes[absent & (rng.random(turns) < _NOTHING_BEHIND)] = Status.NO_TARGET
        means, place, first = _held(levels, edges[: turns + 1], frames)
        status = codes[place].astype(np.uint8)
        came = first & (codes[place - 1] == Status.NO_TARGET) & (status != Status.NO_TARGET)
        status[came] = Status.NO_PREVIOUS_TARGET
        return means, status

    def advance(self, frames: int) -> tuple[Singles, Codes]:
        """Return the next signals and statuses; together = all zones see shares of one target."""
        if self._together:
            signal, status = self._course(frames)
            shares = self._rng.uniform(0.05, 1, self._zones).astype(np.float32)
            shared = np.maximum(signal[:, None] * shares, np.float32(WALL_SIGNAL))
            return shared, np.repeat(status[:, None], self._zones, axis=1)
        courses = [self._course(frames) for _ in range(self._zones)]
        signals, statuses = zip(*courses, strict=True)
        return np.stack(signals, axis=1), np.stack(statuses, axis=1)


class Blinking:
    """What has the bit clock and is no marker: random bits, or a random level a bit."""

    def __init__(self, sensor: Sensor, rng: Any, *, levels: bool = False) -> None:
        self._zones, self._rng, self._levels = sensor.grid.zones, rng, levels
        self._bit_frames = BIT_PERIOD_S / sensor.period_s

    def advance(self, frames: int) -> tuple[Singles, None]:
        """Return the next signals; every zone has another phase in each block."""
        bits = 2 + int(frames / self._bit_frames)
        edges = self._bit_frames * np.arange(bits + 1)
        signals = np.empty((frames, self._zones), dtype=np.float32)
        for zone in range(self._zones):
            drawn = self._rng.random(bits)
            values = BLINKING_SIGNAL * (drawn if self._levels else drawn < 0.5)
            phase = self._bit_frames * self._rng.random()
            signals[:, zone] = _held(values, edges - phase, frames)[0]
        return signals + np.float32(WALL_SIGNAL), None


def _sensed(
    signal: Singles, status: Codes | None, begin: int, sensor: Sensor, rng: np.random.Generator
) -> Recording:
    """Return signals without noise, shape (frames, zones), as frames of a sensor."""
    shape = signal.shape
    noise, ranging = sensor.noise or NOISE, sensor.ranging or SENSOR.ranging
    assert ranging is not None
    distance = np.minimum(
        _NEAR_M * np.sqrt(_NEAR_SIGNAL / np.maximum(signal, LEAST_SIGNAL)), _FAR_M
    )
    spread = np.hypot(ranging.shot / np.maximum(signal, LEAST_SIGNAL), ranging.floor)
    distance += spread * rng.standard_normal(shape, dtype=np.float32)
    sigma = np.sqrt(noise.floor + noise.slope * signal)
    signal = np.maximum(signal + sigma * rng.standard_normal(shape, dtype=np.float32), 0)
    if status is None:
        status = np.full(shape, Status.VALID, dtype=np.uint8)
    none = status == Status.NO_TARGET
    signal[none] = 0.0
    distance[none] = np.nan
    sequence = np.arange(begin, begin + shape[0])
    time_us = np.rint((sequence + 0.5) * sensor.period_s * 1e6).astype(np.int64)
    return Recording(
        stamp_ns=time_us * 1000,
        sequence=sequence,
        sensor_time_us=time_us,
        grid=sensor.grid,
        distance=distance,
        signal=signal,
        ambient=np.zeros(shape, dtype=np.float32),
        status=status,
    )


def source_blocks(
    make: Callable[[Sensor, np.random.Generator], Source],
    duration_s: float,
    rng: np.random.Generator,
    sensor: Sensor = SENSOR,
) -> Iterator[Recording]:
    """Yield the frames of a source in blocks."""
    source = make(sensor, rng)
    total = round(duration_s / sensor.period_s)
    for begin in range(0, total, BLOCK_FRAMES):
        signal, status = source.advance(min(BLOCK_FRAMES, total - begin))
        yield _sensed(signal, status, begin, sensor, rng)


restless_blocks = partial(source_blocks, Hands)
"""Yields the frames of hands that never rest, for a duration [s]."""
wall_blocks = partial(source_blocks, partial(White, signals=(WALL_SIGNAL, WALL_SIGNAL)))
"""Yields the frames of a bare wall."""
_SOURCES: dict[str, Callable[[Sensor, Any], Source]] = {
    'white': White,
    **{f'walk {step:g}': partial(Walk, step=step) for step in (0.1, 0.3, 1.0, 3.0)},
    **{f'heavy walk {step:g}': partial(Walk, step=step, heavy=True) for step in (0.1, 0.5, 2.0)},
    'come and go': Targets,
    'come together': partial(Targets, together=True),
    'hands': Hands,
    'random bits': Blinking,
    'random levels': partial(Blinking, levels=True),
}
FAMILY = tuple(
    Member(name, partial(source_blocks, make), blinks='random' in name)
    for name, make in _SOURCES.items()
)
