# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Restless scenes without a marker: hands that move and bodies that pass, in every zone.

The logarithm of each zone's signal walks about. Its steps are as a public recording of a moving
hand has them: from frame to frame |ln ratio| is 0.10, 0.41, 1.40 and 3.08 at 50, 90, 99 and
99.9 %. A normal step whose scale is itself log-normal has such tails; the scale changes slowly,
so that calm and hurry alternate. Targets vanish and come back, and some zones see nothing.
"""

import math

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.sensor.frame import Floats, Status

LEAST_SIGNAL, MOST_SIGNAL = 2.0, 1700.0  # [kcps/SPAD]
# The steps of the log signal: the median of their scale, and the spread of its logarithm. The
# noise that the sensor adds is in the quantiles above, so these are found by trial.
_STEP_SCALE = 0.113
_STEP_SPREAD = 0.95
_STEP_MEMORY = 0.95  # of the scale, a frame: half a second
_HOME = math.log(150.0)  # where the log signal drifts back to
_LEVEL_MEMORY = 0.99  # of the log signal, a frame: two seconds
_VANISHING, _RETURNING = 0.04, 0.12  # a frame
_INVALID = np.array([Status.NO_TARGET, Status.SIGNAL_TOO_LOW, 4], dtype=np.uint8)
_INVALID_SHARES = (0.8, 0.1, 0.1)
_EMPTY = 0.1  # share of the zones that see nothing, drawn for every block
_CHUNK = 256  # samples, such that memory to this power is no denormal number


def _walk(steps: Floats, memory: float, before: Floats) -> Floats:
    """Return y[t] = memory · y[t-1] + steps[t] along the first axis, `before` being y[-1]."""
    walked = np.empty_like(steps)
    for begin in range(0, len(steps), _CHUNK):
        chunk = steps[begin : begin + _CHUNK]
        fading = memory ** np.arange(1, len(chunk) + 1)[:, None]
        walked[begin : begin + len(chunk)] = fading * (before + np.cumsum(chunk / fading, axis=0))
        before = walked[begin + len(chunk) - 1]
    return walked


def _statuses(frames: int, zones: int, rng: np.random.Generator) -> NDArray[np.uint8]:
    """Return statuses of targets that vanish and come back, shape (frames, zones)."""
    turns = 16 + frames // 16  # a turn takes 33 frames in the mean
    status = np.empty((frames, zones), dtype=np.uint8)
    for zone in range(zones):
        back = np.ones(turns, dtype=np.int64)
        lengths = [back, rng.geometric(_VANISHING, turns) - 1, rng.geometric(_RETURNING, turns)]
        kinds = np.full((turns, 3), (Status.NO_PREVIOUS_TARGET, Status.VALID, Status.NO_TARGET))
        kinds[:, 2] = rng.choice(_INVALID, turns, p=_INVALID_SHARES)
        status[:, zone] = np.repeat(kinds.ravel(), np.column_stack(lengths).ravel())[:frames]
    status[:, rng.random(zones) < _EMPTY] = Status.NO_TARGET
    return status


class Hands:
    """Hands that move and bodies that pass: a source of `evaluation.bench.disturbances`."""

    def __init__(self, sensor: Sensor, rng: np.random.Generator) -> None:
        self._rng, self._level = rng, np.zeros(sensor.grid.zones)
        self._scale = rng.standard_normal(sensor.grid.zones) * _STEP_SPREAD

    def advance(self, frames: int) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Return the next signals without noise and their statuses, shape (frames, zones)."""
        shape = (frames, len(self._level))
        pushes = self._rng.standard_normal(shape)
        pushes *= _STEP_SPREAD * math.sqrt(1 - _STEP_MEMORY**2)
        scale = _walk(pushes, _STEP_MEMORY, self._scale)
        self._scale = scale[-1]
        steps = _STEP_SCALE * np.exp(scale) * self._rng.standard_normal(shape)
        level = _walk(steps, _LEVEL_MEMORY, self._level)
        self._level = level[-1]
        # It turns round at its bounds.
        low, high = math.log(LEAST_SIGNAL), math.log(MOST_SIGNAL)
        received = np.exp(high - np.abs((_HOME + level - low) % (2 * (high - low)) - (high - low)))
        status = _statuses(*shape, self._rng)
        received[status == Status.SIGNAL_TOO_LOW] = 0.0
        return received.astype(np.float32), status
