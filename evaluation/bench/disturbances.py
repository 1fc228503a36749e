# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenes without a marker that may look like one: in these, the budget of false IDs holds.

Each member yields blocks of frames that follow each other. Signals that walk do so where the
sensor's noise is one everywhere: in the square root of the signal, so that a step is a share of
the noise at every level. All of it is computed block by block, for all zones at once.

Hands that move and bodies that pass, in every zone: the logarithm of each zone's signal walks
about. Its steps are as a public recording of a moving hand has them: from frame to frame
|ln ratio| is 0.10, 0.41, 1.40 and 3.08 at 50, 90, 99 and 99.9 %. A normal step whose scale is
itself log-normal has such tails; the scale changes slowly, so that calm and fast motion alternate.
Targets vanish and come back, and some zones see nothing.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.recordings import log_uniform, reflected
from evaluation.bench.room_markers import foreign_edges, foreign_ratio
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.scene.reference import NOISE, RANGING, SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats, Recording
from retrolidar_ros.sensor.model import Status

BLOCK_FRAMES = 4096
MIN_SIGNAL, MAX_SIGNAL = 2.0, 1700.0  # [kcps/SPAD]
PRESENT_SIGNALS, BLINKING_SIGNAL = (5.0, 1000.0), 100.0
PRESENT_S = (0.1, 3.0)
_ZONES, _PERIOD_S = SENSOR.grid.zones, SENSOR.period_s
_NEAR_M, _NEAR_SIGNAL, _FAR_M = 0.2, 1700.0, 6.0  # distances follow the square root of signals
_NOTHING_BEHIND = 0.3  # share of the absences in which there is no wall either
_MERGED = 0.1  # share of what appears that is reported as merged
# The steps of the log signal of hands: the median of their scale, and the spread of its logarithm.
# The quantiles above contain the sensor's noise, so these are found by trial.
_STEP_SCALE, _STEP_SPREAD = 0.113, 0.95
_STEP_MEMORY = 0.95  # of the scale, a frame: half a second
_HOME = math.log(150.0)  # where the log signal drifts back to
_LEVEL_MEMORY = 0.99  # of the log signal, a frame: two seconds
_VANISHING, _RETURNING = 0.04, 0.12  # a frame
_INVALID = np.array([Status.NO_TARGET, Status.SIGNAL_TOO_LOW, 4], dtype=np.uint8)
_INVALID_SHARES = (0.8, 0.1, 0.1)
_EMPTY = 0.1  # share of the zones that see nothing, drawn for every block
_CHUNK = 256  # samples, such that memory to this power is no denormal number

Singles = NDArray[np.float32]
Codes = NDArray[np.uint8]
Source = Callable[[int], tuple[Singles, Codes | None]]
"""Returns the next signals without noise [kcps/SPAD], and statuses unless all are valid.

Both are of shape (frames, zones); where there is no target the signal does not count.
"""


class Member(NamedTuple):
    """One member of the family."""

    name: str
    blocks: Callable[[float, np.random.Generator], Iterator[Recording]]
    """Yields the frames of a duration [s]."""
    blinks: bool = False
    """Whether it blinks: the rate of false IDs is reported, and not held to a budget."""


def white(rng: np.random.Generator, signals: tuple[float, float] = (4.0, 600.0)) -> Source:
    """Return noise alone, in every zone at another level."""
    levels = rng.permutation(np.geomspace(*signals, _ZONES, dtype=np.float32))
    return lambda frames: (np.tile(levels, (frames, 1)), None)


def _scaled(signal: float) -> float:
    """Return a signal [kcps/SPAD] on the scale on which the sensor's noise is one."""
    return 2 / NOISE.slope * math.sqrt(NOISE.floor + NOISE.slope * signal)


def _walk(rng: np.random.Generator, *, step: float, heavy: bool = False) -> Source:
    """Return signals that walk between bounds, in steps of a share of the noise.

    Heavy-tailed steps are of Student's t with two degrees.
    """
    low, high = _scaled(MIN_SIGNAL), _scaled(MAX_SIGNAL)
    last = rng.uniform(low, high, _ZONES)

    def advance(frames: int) -> tuple[Singles, None]:
        shape = (frames, _ZONES)
        steps = rng.standard_normal(shape, dtype=np.float32)
        if heavy:
            # Of so many numbers some are rounded to zero.
            spread = np.maximum(rng.standard_exponential(shape, dtype=np.float32), 1e-9)
            steps /= np.sqrt(spread)
        walked = reflected(last + np.cumsum(step * steps, axis=0, dtype=np.float64), low, high)
        last[:] = walked[-1]
        scaled = (NOISE.slope / 2 * walked).astype(np.float32)
        return (scaled * scaled - np.float32(NOISE.floor)) / np.float32(NOISE.slope), None

    return advance


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


def _course(frames: int, rng: np.random.Generator) -> tuple[Singles, Codes]:
    """Return signals and statuses of a zone where targets come and go, shape (frames,)."""
    turns = 2 + int(frames * _PERIOD_S / PRESENT_S[0])
    lasting = log_uniform(PRESENT_S, rng, turns) / _PERIOD_S
    edges = np.concatenate([[0.0], np.cumsum(lasting)]) - lasting[0] * rng.random()
    turns = int(np.searchsorted(edges, frames))
    levels = log_uniform(PRESENT_SIGNALS, rng, turns)
    codes = np.where(rng.random(turns) < _MERGED, Status.MERGED, Status.VALID)
    # Every second one is absent.
    absent = np.arange(turns) % 2 == rng.integers(2)
    levels[absent] = WALL_SIGNAL
    codes[absent & (rng.random(turns) < _NOTHING_BEHIND)] = Status.NO_TARGET
    means, place, first = _held(levels, edges[: turns + 1], frames)
    status = codes[place].astype(np.uint8)
    came = first & (codes[place - 1] == Status.NO_TARGET) & (status != Status.NO_TARGET)
    status[came] = Status.NO_PREVIOUS_TARGET
    return means, status


def _targets(rng: np.random.Generator) -> Source:
    """Return targets that come and go, with levels and durations of their own, before a wall."""

    def advance(frames: int) -> tuple[Singles, Codes]:
        signals, statuses = zip(*(_course(frames, rng) for _ in range(_ZONES)), strict=True)
        return np.stack(signals, axis=1), np.stack(statuses, axis=1)

    return advance


def _target(rng: np.random.Generator) -> Source:
    """Return one target that comes and goes, of which all zones see shares."""

    def advance(frames: int) -> tuple[Singles, Codes]:
        signal, status = _course(frames, rng)
        shares = rng.uniform(0.05, 1, _ZONES).astype(np.float32)
        shared = np.maximum(signal[:, None] * shares, np.float32(WALL_SIGNAL))
        return shared, np.repeat(status[:, None], _ZONES, axis=1)

    return advance


def _each_zone(zone: Callable[[int], Singles]) -> Source:
    """Return what blinks before a wall, in every zone by itself and anew in each block."""
    wall = np.float32(WALL_SIGNAL)
    return lambda frames: (np.stack([zone(frames) for _ in range(_ZONES)], axis=1) + wall, None)


def _blinking(rng: np.random.Generator, *, levels: bool = False) -> Source:
    """Return random bits at the markers' bit clock, or a random level for each bit."""
    bit_frames = BIT_PERIOD_S / _PERIOD_S

    def zone(frames: int) -> Singles:
        bits = 2 + int(frames / bit_frames)
        drawn = rng.random(bits)
        values = BLINKING_SIGNAL * (drawn if levels else drawn < 0.5)
        edges = bit_frames * np.arange(bits + 1) - bit_frames * rng.random()
        return _held(values, edges, frames)[0]

    return _each_zone(zone)


def _foreign(rng: np.random.Generator, *, sending: str) -> Source:
    """Return foreign markers that repeat, one in every zone, others in each block."""

    def zone(frames: int) -> Singles:
        bit_s = BIT_PERIOD_S * (foreign_ratio(rng) if sending == 'period' else 1.0)
        begin_s = -PACKET_BITS * bit_s * rng.random()
        edges_s, levels = foreign_edges(sending, bit_s, begin_s, frames * _PERIOD_S, rng)
        means = _held(levels[:-1], edges_s / _PERIOD_S, frames)[0]
        return np.float32(BLINKING_SIGNAL) * means

    return _each_zone(zone)


def _fading(steps: Floats, memory: float, before: Floats) -> Floats:
    """Return y[t] = memory · y[t-1] + steps[t] along the first axis, `before` being y[-1]."""
    walked = np.empty_like(steps)
    for begin in range(0, len(steps), _CHUNK):
        chunk = steps[begin : begin + _CHUNK]
        fading = memory ** np.arange(1, len(chunk) + 1)[:, None]
        walked[begin : begin + len(chunk)] = fading * (before + np.cumsum(chunk / fading, axis=0))
        before = walked[begin + len(chunk) - 1]
    return walked


def _vanishing(frames: int, rng: np.random.Generator) -> Codes:
    """Return statuses of targets that vanish and come back, shape (frames, zones)."""
    turns = 16 + frames // 16  # a turn takes 33 frames in the mean
    status = np.empty((frames, _ZONES), dtype=np.uint8)
    for zone in range(_ZONES):
        back = np.ones(turns, dtype=np.int64)
        lengths = [back, rng.geometric(_VANISHING, turns) - 1, rng.geometric(_RETURNING, turns)]
        kinds = np.full((turns, 3), (Status.NO_PREVIOUS_TARGET, Status.VALID, Status.NO_TARGET))
        kinds[:, 2] = rng.choice(_INVALID, turns, p=_INVALID_SHARES)
        status[:, zone] = np.repeat(kinds.ravel(), np.column_stack(lengths).ravel())[:frames]
    status[:, rng.random(_ZONES) < _EMPTY] = Status.NO_TARGET
    return status


def _hands(rng: np.random.Generator) -> Source:
    level, scale = np.zeros(_ZONES), rng.standard_normal(_ZONES) * _STEP_SPREAD

    def advance(frames: int) -> tuple[Singles, Codes]:
        pushes = rng.standard_normal((frames, _ZONES))
        pushes *= _STEP_SPREAD * math.sqrt(1 - _STEP_MEMORY**2)
        scales = _fading(pushes, _STEP_MEMORY, scale)
        steps = _STEP_SCALE * np.exp(scales) * rng.standard_normal((frames, _ZONES))
        levels = _fading(steps, _LEVEL_MEMORY, level)
        scale[:], level[:] = scales[-1], levels[-1]
        bounds = math.log(MIN_SIGNAL), math.log(MAX_SIGNAL)
        received = np.exp(reflected(_HOME + levels, *bounds))
        status = _vanishing(frames, rng)
        received[status == Status.SIGNAL_TOO_LOW] = 0.0
        return received.astype(np.float32), status

    return advance


def _sensed(
    signal: Singles, status: Codes | None, begin: int, rng: np.random.Generator
) -> Recording:
    """Return signals without noise, shape (frames, zones), as frames of the sensor."""
    shape, light = signal.shape, np.maximum(signal, MIN_SIGNAL)
    distance = np.minimum(_NEAR_M * np.sqrt(_NEAR_SIGNAL / light), _FAR_M)
    spread = np.hypot(RANGING.shot / light, RANGING.floor)
    distance += spread * rng.standard_normal(shape, dtype=np.float32)
    sigma = np.sqrt(NOISE.floor + NOISE.slope * signal)
    signal = np.maximum(signal + sigma * rng.standard_normal(shape, dtype=np.float32), 0)
    if status is None:
        status = np.full(shape, Status.VALID, dtype=np.uint8)
    none = status == Status.NO_TARGET
    signal[none] = 0.0
    distance[none] = np.nan
    sequence = np.arange(begin, begin + shape[0])
    time_us = np.rint((sequence + 0.5) * _PERIOD_S * 1e6).astype(np.int64)
    seen = distance, signal, np.zeros(shape, dtype=np.float32), status
    return Recording(time_us * 1000, sequence, time_us, SENSOR.grid, *seen)


def source_blocks(
    make: Callable[[np.random.Generator], Source], duration_s: float, rng: np.random.Generator
) -> Iterator[Recording]:
    """Yield the frames of a source in blocks."""
    advance, total = make(rng), round(duration_s / _PERIOD_S)
    for begin in range(0, total, BLOCK_FRAMES):
        yield _sensed(*advance(min(BLOCK_FRAMES, total - begin)), begin, rng)


# Yield frames for a duration [s].
restless_blocks = partial(source_blocks, _hands)
wall_blocks = partial(source_blocks, partial(white, signals=(WALL_SIGNAL, WALL_SIGNAL)))
_SOURCES: dict[str, Callable[[np.random.Generator], Source]] = {
    'white': white,
    **{f'walk {step:g}': partial(_walk, step=step) for step in (0.1, 0.3, 1.0, 3.0)},
    **{f'heavy walk {step:g}': partial(_walk, step=step, heavy=True) for step in (0.1, 0.5, 2.0)},
    'come and go': _targets,
    'come together': _target,
    'hands': _hands,
    'random bits': _blinking,
    'random levels': partial(_blinking, levels=True),
    'other bit periods': partial(_foreign, sending='period'),
    'bits of any length': partial(_foreign, sending='clock'),
    'another preamble': partial(_foreign, sending='preamble'),
}
_BLINKING = [*_SOURCES][-5:]  # the last of them
FAMILY = tuple(
    Member(name, partial(source_blocks, make), blinks=name in _BLINKING)
    for name, make in _SOURCES.items()
)
