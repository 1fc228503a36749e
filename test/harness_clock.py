# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A sensor whose clock is wrong, and a transport that delays, as a driver sees them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.sensor.clock import ClockMap

PERIOD_S = 0.021
SLOW_PERIOD_S = 1 / 15
LEAST_DELAY_S = 0.005
START_NS = 1_700_000_000_000_000_000
BOOTED_US = 5_000_000

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class Run:
    """What a driver sees of some frames, and the truth; arrays of shape (frames,)."""

    true_s: Floats
    sensor_us: Integers
    host_ns: Integers
    """The host's clock at the middle of the exposure."""
    arrival_ns: Integers

    def only(self, kept: NDArray[np.bool_]) -> Run:
        """Lose the other frames."""
        return Run(*(values[kept] for values in vars(self).values()))

    def host_set(self, at_s: float, step_s: float) -> Run:
        """Set the host's clock once."""
        step_ns = np.where(self.true_s >= at_s, round(step_s * 1e9), 0)
        return replace(self, host_ns=self.host_ns + step_ns, arrival_ns=self.arrival_ns + step_ns)

    def stalled(self, at_s: float, length_s: float) -> Run:
        """Hold back for some time all that would arrive."""
        end_ns = START_NS + round((at_s + length_s) * 1e9)
        held = (self.arrival_ns > START_NS + round(at_s * 1e9)) & (self.arrival_ns < end_ns)
        return replace(self, arrival_ns=np.where(held, end_ns, self.arrival_ns))

    def at(self, start_s: float, stop_s: float = np.inf) -> NDArray[np.bool_]:
        return (self.true_s >= start_s) & (self.true_s < stop_s)


def simulate(
    length_s: float,
    skew: float = 0.0,
    seed: int = 0,
    period_s: float = PERIOD_S,
    sensor_error_s: Callable[[Floats], Floats] | None = None,
) -> Run:
    """Simulate a sensor whose clock is `skew` fast, and a transport that keeps the order.

    Frames jitter by 1 ms; delays are exponential with a mean of 2 ms over the least, and one
    frame in a hundred takes another 30 ms on average.
    """
    rng = np.random.default_rng(seed)
    count = round(length_s / period_s)
    jitter_s = rng.normal(0, 0.001, count).clip(-0.002, 0.002)
    true_s = period_s * np.arange(count) + jitter_s
    delay_s = LEAST_DELAY_S + rng.exponential(0.002, count)
    delay_s += (rng.random(count) < 0.01) * rng.exponential(0.03, count)
    error_s = skew * true_s if sensor_error_s is None else sensor_error_s(true_s)
    return Run(
        true_s,
        BOOTED_US + np.rint((true_s + error_s) * 1e6).astype(np.int64),
        START_NS + np.rint(true_s * 1e9).astype(np.int64),
        START_NS + np.rint(np.maximum.accumulate(true_s + delay_s) * 1e9).astype(np.int64),
    )


def map_all(clock_map: ClockMap, run: Run) -> Integers:
    pairs = zip(run.sensor_us.tolist(), run.arrival_ns.tolist(), strict=True)
    return np.array([clock_map.map(*pair) for pair in pairs], dtype=np.int64)


def errors_ms(run: Run, stamps_ns: Integers) -> Floats:
    errors: Floats = (stamps_ns - run.host_ns).astype(np.float64) / 1e6
    return errors


def checked_errors_ms(run: Run, restarts: int = 0, set_back: bool = False) -> Floats:
    """Return stamp less truth of each frame, having checked what holds for all stamps."""
    clock_map = ClockMap(LEAST_DELAY_S)
    stamps_ns = map_all(clock_map, run)
    assert clock_map.restarts == restarts
    assert (np.diff(stamps_ns) <= 0).sum() == set_back
    assert (stamps_ns < run.arrival_ns).all()
    return errors_ms(run, stamps_ns)


def worst(errors: Floats) -> float:
    return float(np.abs(errors).max())
