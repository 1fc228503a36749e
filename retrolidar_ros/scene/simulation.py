# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the sensor reports of a scene, frame after frame."""

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.scene import optics
from retrolidar_ros.scene.description import (
    NEAREST_M,
    Marker,
    Noise,
    Ranging,
    Scene,
    Sensor,
    Surface,
)
from retrolidar_ros.scene.transmission import Transmission, exposure_edges, recurring_share
from retrolidar_ros.sensor.frame import Floats, Recording
from retrolidar_ros.sensor.model import VL53L8CX, Status

_PURE_SHARE = 0.95  # of the strongest target; with less a pulse counts as merged
# Codes that the sensor gives to measurements it does not trust.
_ABNORMAL = np.array(
    [Status.NOT_UPDATED, Status.SIGNAL_TOO_LOW_ON_ARRAY, Status.SIGMA_TOO_HIGH, 4, 7, 8, 11],
    dtype=np.uint8,
)
_GARBAGE_SIGNAL = 100.0  # [kcps/SPAD]
_GARBAGE_DISTANCE_M = 4.0
_GLASS_M = 0.01  # how far a cover glass is, or nearly so


class Simulation:
    """A running scene: one seeded generator, and blocks of frames without a seam."""

    def __init__(self, scene: Scene, rng: np.random.Generator | None = None) -> None:
        """Start `scene` at its time zero, with its own seed unless a generator is given."""
        self.scene = scene
        self._rng = np.random.default_rng(scene.seed) if rng is None else rng
        self._frames_done = 0
        self._transmissions = [Transmission.of(marker) for marker in scene.markers]
        self._had_target = np.ones(scene.sensor.grid.zones, dtype=bool)

    @property
    def period_s(self) -> float:
        """The true frame period [s]."""
        return self.scene.sensor.period_s * (1 + self.scene.sensor.period_error)

    def exposure_times(self, count: int) -> tuple[NDArray[np.int64], Floats]:
        """Return sequence numbers and true middles [s] of the next exposures, and go past them."""
        sensor = self.scene.sensor
        sequence: NDArray[np.int64] = np.arange(self._frames_done, self._frames_done + count)
        self._frames_done += count
        middle_s = ((sequence + 0.5) * self.period_s).astype(np.float64)
        if sensor.jitter_s:
            # Bounded, so that no frame overtakes the next one.
            deviation = np.clip(self._rng.standard_normal(count), -2, 2)
            middle_s = middle_s + sensor.jitter_s * deviation
        if sensor.lost:
            kept = self._rng.random(count) >= sensor.lost
            sequence, middle_s = sequence[kept], middle_s[kept]
        return sequence, middle_s

    def advance(self, count: int) -> Recording:
        """Return the next `count` frames, less those that the scene loses."""
        scene, sensor = self.scene, self.scene.sensor
        sequence, middle_s = self.exposure_times(count)
        signals, distances = _seen_in_each_zone(*self.targets(middle_s))
        signal, distance, merged = _reported_pulse(signals, distances)
        ambient: Floats = np.full((len(middle_s), 1), scene.ambient)
        if (second := sensor.second_sensor) is not None:
            # Its pulses are not in step with this sensor's, so they count as ambient light does.
            share = recurring_share(second.period_s, second.lasting_s, middle_s, self.period_s)
            ambient += second.ambient * share[:, None]
        if sensor.saturation < math.inf:
            signal = optics.saturated(signal, ambient, sensor.saturation)
        if sensor.ranging is not None and sensor.ranging.offset:
            distance = distance + sensor.ranging.offset * sensor.grid.z_per_range
        distance = deviating(distance, signal, sensor.ranging, self._rng)
        signal = noisy(signal, sensor.noise, self._rng, ambient)
        status = np.where(merged, Status.MERGED, Status.VALID).astype(np.uint8)
        self._drop_weak(signal, distance, status)
        if sensor.abnormal:
            self._add_garbage(signal, distance, status)
        sensor_time_us = np.rint(middle_s * (1 + sensor.clock_error) * 1e6).astype(np.int64)
        return Recording(
            stamp_ns=sensor_time_us * 1000,
            sequence=sequence,
            sensor_time_us=sensor_time_us,
            grid=sensor.grid,
            distance=distance.astype(np.float32),
            signal=signal.astype(np.float32),
            ambient=np.broadcast_to(ambient, signal.shape).astype(np.float32),
            status=status,
        )

    def blocks(self, duration_s: float | None, block_frames: int = 1024) -> Iterator[Recording]:
        """Yield the frames of a duration [s] in blocks; without one, never end."""
        remaining = math.inf if duration_s is None else round(duration_s / self.period_s)
        while remaining > 0:
            count = int(min(block_frames, remaining))
            remaining -= count
            yield self.advance(count)

    def run(self, duration_s: float) -> Recording:
        """Return the frames of a duration [s] as one recording."""
        return self.advance(round(duration_s / self.period_s))

    def targets(self, middle_s: Floats) -> tuple[Floats, Floats]:
        """Return signal [kcps/SPAD] and z [m] of every target: shape (targets, frames, zones)."""
        scene, sensor = self.scene, self.scene.sensor
        seen = [
            self._see_marker(marker, transmission, middle_s)
            for marker, transmission in zip(scene.markers, self._transmissions, strict=True)
        ] + [optics.see_surface(sensor, surface, middle_s) for surface in scene.surfaces]
        for moving in scene.moving_surfaces:
            signal, depth, hidden = optics.see_moving(sensor, moving, middle_s)
            seen = [(own * np.where(z > depth, 1 - hidden, 1.0), z) for own, z in seen]
            seen.append((signal, depth))
        if sensor.crosstalk:
            # A cover glass is a near target in every zone (ST UM3109).
            glass = Surface(_GLASS_M, sensor.crosstalk)
            seen.append(optics.see_surface(Sensor(sensor.grid), glass, middle_s))
        signals = np.zeros((len(seen), len(middle_s), sensor.grid.zones))
        distances = np.zeros_like(signals)
        for index, (signal, distance) in enumerate(seen):
            signals[index] = signal
            distances[index] = distance
        return signals, distances

    def _see_marker(
        self, marker: Marker, transmission: Transmission, middle_s: Floats
    ) -> tuple[Floats, Floats]:
        sensor = self.scene.sensor
        position_m = optics.seen_from(sensor, optics.position_at(marker, middle_s), middle_s)
        position_m, ahead = optics.in_front(position_m)
        range_m = np.linalg.norm(position_m, axis=-1)
        blocked = 1 - transmission.mean(exposure_edges(middle_s, self.period_s))
        light = 1 - marker.contrast * blocked
        if (hidden := marker.occlusion) is not None:
            share = recurring_share(hidden.every_s, hidden.lasting_s, middle_s, self.period_s)
            light = light * (1 - share)
        light = light * optics.received_signal(
            range_m, marker.size_m**2, marker.yaw_rad, marker.signal_at_1_m
        )
        shares = optics.zone_shares(position_m, marker.size_m, sensor.grid, sensor.blur)
        return light[:, None] * shares * ahead, range_m[:, None] * sensor.grid.z_per_range

    def _drop_weak(self, signal: Floats, distance: Floats, status: NDArray[np.uint8]) -> None:
        """Report no target below the threshold, and mark the first range after it (in place)."""
        threshold = self.scene.sensor.target_threshold
        none = (signal < threshold) | np.isnan(distance)
        if none.any():
            before = np.concatenate([self._had_target[None], ~none[:-1]])
            status[~none & ~before] = Status.NO_PREVIOUS_TARGET
            status[none] = Status.NO_TARGET
            signal[none] = 0.0
            distance[none] = np.nan
        if len(none):
            self._had_target = ~none[-1]

    def _add_garbage(self, signal: Floats, distance: Floats, status: NDArray[np.uint8]) -> None:
        """Replace samples by meaningless ones with an abnormal status (in place)."""
        hit = self._rng.random(signal.shape) < self.scene.sensor.abnormal
        count = np.count_nonzero(hit)
        signal[hit] = _GARBAGE_SIGNAL * self._rng.random(count)
        distance[hit] = _GARBAGE_DISTANCE_M * self._rng.random(count)
        status[hit] = self._rng.choice(_ABNORMAL, count)


def _seen_in_each_zone(signals: Floats, distances: Floats) -> tuple[Floats, Floats]:
    """Return the targets that each zone sees, in their order; mostly they are one or two."""
    seen = signals.any(axis=1)
    order = np.argsort(~seen, axis=0, kind='stable')[: seen.sum(axis=0).max(), None]
    return np.take_along_axis(signals, order, axis=0), np.take_along_axis(distances, order, axis=0)


def _reported_pulse(signals: Floats, distances: Floats) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """Return signal, z [m] and whether it is merged, of the strongest pulse in each zone.

    Targets too near to each other to be separated make one pulse: signals add, and the
    distance is their mean weighted by signal. NaN distance where nothing reflects enough to see.
    """
    best_signal = np.zeros(signals.shape[1:])
    best_distance = np.full(signals.shape[1:], np.nan)
    best_merged = np.zeros(signals.shape[1:], dtype=bool)
    for around, own in zip(distances, signals, strict=True):
        pulse = np.where(np.abs(distances - around) < VL53L8CX.separable_m, signals, 0.0)
        signal = pulse.sum(axis=0)
        strongest = pulse.max(axis=0)
        # A pulse is about its strongest target, so a weak one between two does not join them.
        stronger = (signal > best_signal) & (own == strongest) & (signal >= VL53L8CX.signal_step)
        weighted = (pulse * distances).sum(axis=0)
        best_distance[stronger] = weighted[stronger] / signal[stronger]
        best_merged[stronger] = (strongest < _PURE_SHARE * signal)[stronger]
        best_signal[stronger] = signal[stronger]
    return best_signal, best_distance, best_merged


def noisy(
    signal: Floats, noise: Noise | None, rng: np.random.Generator, ambient: Floats | float = 0.0
) -> Floats:
    """Add noise to signals of any shape in ambient light [kcps/SPAD]; none gets negative."""
    if noise is None:
        return signal
    sigma: Floats = np.sqrt(noise.floor + noise.slope * signal + noise.ambient * ambient)
    return np.maximum(signal + sigma * rng.standard_normal(signal.shape), 0.0)


def deviating(
    distance: Floats, signal: Floats, ranging: Ranging | None, rng: np.random.Generator
) -> Floats:
    """Add its deviation to distances [m] of any shape; none gets behind the sensor."""
    if ranging is None:
        return distance
    shot = np.divide(ranging.shot, signal, out=np.zeros_like(signal), where=signal > 0)
    sigma: Floats = np.hypot(shot, ranging.floor)
    return np.maximum(distance + sigma * rng.standard_normal(signal.shape), NEAREST_M)
