# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of markers under stress: the one mechanism by which most experiments make frames.

A marker stands in the middle of every zone, or one marker moves through all of them. The
light of all zones is computed at once; what happens to light comes first, then the sensor's
noise that belongs to it, then what the sensor does to its samples.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evaluation.bench.stresses import PLAIN, Stress
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import (
    MARKER_SIZE_M,
    SIGNAL_AT_1_M,
    Noise,
    Response,
    SecondSensor,
)
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, received_signal, zone_shares
from retrolidar_ros.scene.reference import NOISE, RESPONSE, SENSOR, WALL_SIGNAL
from retrolidar_ros.scene.simulation import noisy
from retrolidar_ros.scene.transmission import Transmission, exposure_edges, recurring_share
from retrolidar_ros.sensor.frame import Floats, Recording
from retrolidar_ros.sensor.model import Status

HAND_SIGNAL, HAND_DISTANCE_M = 1700.0, 0.2  # [kcps/SPAD]
SILENCE_BITS = 40  # before a lone packet: 1.7 s
SECOND_CLOCK_ERROR = 0.01  # largest relative error of a second marker's clock
WANDER_S = 0.5  # time in which a wandering wall goes its share of the bright signal
FAR_WALL_M = 1.0  # how far a wall that is separated stands behind the marker
GLASS_M = 0.01
_BLUR = 0.05  # of what a marker that moves is seen by, in zones
NEIGHBOUR_S = (0.033, 0.011)  # frame period of another sensor, and how long it sends in each
_TAIL_BITS = 16  # after the last packet: a reading of it comes within half a second

Path = Callable[[Floats], Floats]  # positions [m], shape (n, 3), at times [s], shape (n,)


class Sent(NamedTuple):
    """A recording, and what its markers sent."""

    recording: Recording
    ids: NDArray[np.int64]  # shape (zones,), or (1,) of one that goes through them
    start_s: Floats  # of the first packet of each marker
    packet_s: float  # how long a packet takes
    seconds: NDArray[np.int64] | None  # IDs of the second markers


def snr_db(signal: float) -> float:
    """Return c over sigma of a bright signal [kcps/SPAD], the noise taken at its half [dB]."""
    variance = NOISE.floor + NOISE.slope * (WALL_SIGNAL + signal / 2)
    return 20 * math.log10(signal / math.sqrt(variance))


def signal_at(range_m: float) -> float:
    """Return how bright a marker of 3 cm is at a distance [m], [kcps/SPAD]."""
    return float(SIGNAL_AT_1_M * range_m**DISTANCE_EXPONENT)


def range_of(signal: float) -> float:
    """Return the range at which a marker of 3 cm has a signal [m]."""
    return float((signal / SIGNAL_AT_1_M) ** (1 / DISTANCE_EXPONENT))


def rng_at(seed: int, place: float) -> np.random.Generator:
    """Return a generator that gives the same frames at a place to every experiment."""
    return np.random.default_rng([seed, round(1000 * place)])


def log_uniform(
    bounds: tuple[float, float], rng: np.random.Generator, size: int | None = None
) -> Any:
    """Return a number between bounds, its logarithm evenly distributed; or so many of them."""
    low, high = np.log(bounds)
    return np.exp(rng.uniform(low, high, size))


def reflected(walked: Floats, low: float, high: float) -> Floats:
    """Return what walks anywhere as between bounds that reflect it."""
    inside: Floats = high - np.abs((walked - low) % (2 * (high - low)) - (high - low))
    return inside


def walk(shape: tuple[int, int], bound: float, step: float, rng: np.random.Generator) -> Floats:
    """Return random walks between 0 and a bound, which reflect them."""
    walked = np.cumsum(step * rng.standard_normal(shape), axis=0) + rng.uniform(0, bound, shape[1])
    return reflected(walked, 0.0, bound)


def to_and_fro(distance: Floats, half: float) -> Floats:
    """Return places to and fro between -half and half, after some distance."""
    turned: Floats = half - np.abs(distance % (4 * half) - 2 * half)
    return turned


def standing(place_m: ArrayLike) -> Path:
    """Return the path of a marker that stays at a place [m], shape (3,)."""
    return lambda time_s: np.tile(place_m, (len(time_s), 1))


class _Zones(Simulation):
    """Bright markers in the middle of all zones, or one that moves, under a stress."""

    def __init__(
        self,
        stress: Stress,
        signal: float,
        rng: np.random.Generator,
        ids: NDArray[np.int64],
        at_m: float,
        repeated_s: float | None,
        ambient: float,
        path: Path | None,
    ) -> None:
        """Draw what the markers send, and when; `at_m` is where they have `signal`."""
        self._stress, self._signal, self._ids = stress, signal, ids
        self._at_m, self._path = at_m, path
        markers = SENSOR.grid.zones if path is None else 1
        if len(ids) < markers:
            raise ValueError(f'{len(ids)} IDs for {markers} markers, each with one of its own')
        self._bit_s = BIT_PERIOD_S * (1 + stress.clock_error)
        self.packet_s = PACKET_BITS * self._bit_s
        self.own = rng.choice(ids, markers, replace=False)
        self.seconds: NDArray[np.int64] | None = None
        self.light: Floats = np.zeros(0)  # without noise, shape (frames, zones)
        self._is_lone = repeated_s is None
        if repeated_s is None:
            self.start_s = BIT_PERIOD_S * (SILENCE_BITS + PACKET_BITS * rng.random(markers))
            self.lasting_s = float(self.start_s.max()) + self.packet_s + _TAIL_BITS * BIT_PERIOD_S
        else:
            self.start_s, self.lasting_s = -self.packet_s * rng.random(markers), repeated_s
        neighbour = SecondSensor(stress.neighbour, *NEIGHBOUR_S) if stress.neighbour else None
        sensor = replace(
            SENSOR,
            # Ambient light is as noisy as what comes back.
            noise=Noise(*(stress.noise * one for one in (NOISE.floor, NOISE.slope, NOISE.slope))),
            jitter_s=stress.jitter_s,
            lost=stress.lost,
            abnormal=stress.abnormal,
            second_sensor=neighbour,
        )
        super().__init__(Scene(sensor=sensor, ambient=ambient), rng)

    def targets(self, middle_s: Floats) -> tuple[Floats, Floats]:
        """Return signal and z of marker and near wall, of the far wall and of the cover glass."""
        stress, top = self._stress, self._signal + WALL_SIGNAL
        shape = (len(middle_s), self.scene.sensor.grid.zones)
        light, ranges_m = self._markers(middle_s)
        light = light + WALL_SIGNAL + stress.pedestal
        if stress.wander:
            step = stress.wander * self._signal * math.sqrt(self.period_s / WANDER_S)
            light += walk(shape, self._signal / 2, step, self._rng)
        if stress.hand_s:
            hidden = self._hidden(middle_s)
            hand = np.broadcast_to(hidden * HAND_SIGNAL, shape)
            light = (1 - hidden) * light
            ranges_m[hand > light] = HAND_DISTANCE_M
            light += hand
        self.light = light = np.minimum(light, stress.clip * top)
        far, glass = (np.full(shape, one) for one in (stress.far_wall * top, stress.glass))
        ranges_m = np.stack([ranges_m, ranges_m + FAR_WALL_M, np.full(shape, GLASS_M)])
        return np.stack([light, far, glass]), ranges_m * self.scene.sensor.grid.z_per_range

    def _markers(self, middle_s: Floats) -> tuple[Floats, Floats]:
        """Return light [kcps/SPAD] and ranges [m] of the markers, shape (frames, zones)."""
        stress, rng, markers = self._stress, self._rng, len(self.own)
        edges_s = exposure_edges(middle_s, self.period_s)
        response = Response(RESPONSE.dark_s, stress.bright_s)

        def sent(ids: NDArray[np.int64], start_s: Floats, bit_s: Floats, packets: float) -> Floats:
            each = zip(packet(ids), bit_s, start_s, strict=True)
            ways = [Transmission(bits, bit, start, response, packets) for bits, bit, start in each]
            return np.column_stack([way.mean(edges_s) for way in ways])

        own_bit_s = np.full(markers, self._bit_s)
        packets = 1 if self._is_lone else math.inf
        light = self._signal * sent(self.own, self.start_s, own_bit_s, packets)
        if stress.sway:
            turn = 2 * math.pi / stress.sway_s * middle_s[:, None]
            light *= 1 + stress.sway * np.sin(turn + rng.uniform(0, 2 * math.pi, markers))
        if stress.occlusion is not None:
            shifted_s = middle_s[:, None] + stress.occlusion.every_s * (1 + rng.random(markers))
            every_s, lasting_s = stress.occlusion.every_s, stress.occlusion.lasting_s
            light *= 1 - recurring_share(every_s, lasting_s, shifted_s, self.period_s)
        if stress.second:
            # Any ID but that of the first marker of the zone.
            ids = self._ids
            places = np.searchsorted(ids, self.own)
            self.seconds = ids[(places + rng.integers(1, len(ids), markers)) % len(ids)]
            bit_s = BIT_PERIOD_S * (1 + SECOND_CLOCK_ERROR * rng.uniform(-1, 1, markers))
            begun_s = -PACKET_BITS * bit_s * rng.random(markers)
            light += stress.second * self._signal * sent(self.seconds, begun_s, bit_s, math.inf)
        grid = self.scene.sensor.grid
        if self._path is None:
            return light, np.full(light.shape, self._at_m)
        position_m = self._path(middle_s)
        ranges_m = np.repeat(np.linalg.norm(position_m, axis=1)[:, None], grid.zones, axis=1)
        share = zone_shares(position_m, MARKER_SIZE_M, grid, _BLUR)
        return light * share * (ranges_m / self._at_m) ** DISTANCE_EXPONENT, ranges_m

    def _hidden(self, middle_s: Floats) -> Floats:
        """Return what share of each exposure a hand hides, in the middle of a packet."""
        from_middle = (middle_s[:, None] - self.start_s) / self.packet_s - 0.5
        # The first packet of a lone marker is also its only one.
        nearest = 0 if self._is_lone else np.rint(from_middle)
        since_s = self.packet_s * (from_middle - nearest)[..., None]
        half_s = self._stress.hand_s / 2
        bounded_s = np.clip(since_s + self.period_s * np.array([-0.5, 0.5]), -half_s, half_s)
        return (bounded_s[..., 1] - bounded_s[..., 0]) / self.period_s


def _lose_targets(
    recording: Recording, light: Floats, share: float, rng: np.random.Generator
) -> Recording:
    """Report no target in a share of the dark samples, and mark the first target after it."""
    middle = (light.min(axis=0) + light.max(axis=0)) / 2
    lost = (light < middle) & (rng.random(light.shape) < share)
    status = np.where(lost, np.uint8(Status.NO_TARGET), recording.status)
    status[1:][~lost[1:] & lost[:-1]] = Status.NO_PREVIOUS_TARGET
    return replace(
        recording,
        signal=np.where(lost, np.float32(0.0), recording.signal),
        distance=np.where(lost, np.float32(np.nan), recording.distance),
        status=status,
    )


def record(
    stress: Stress,
    signal: float,
    rng: np.random.Generator,
    ids: NDArray[np.int64] = USABLE_IDS,
    *,
    range_m: float | None = None,
    repeated_s: float | None = None,
    ambient: float = 0.0,
    path: Path | None = None,
) -> Sent:
    """Return frames of a marker in the middle of every zone, or of one that moves.

    Bright markers have `signal` above the wall [kcps/SPAD], and stand with their walls at `range_m`
    [m], by default where markers of 3 cm are so bright; or the only one is on `path`, and has
    `signal` at `range_m`. Their IDs are drawn from `ids`, shape (n,); ValueError if these are fewer
    than markers. Each sends one packet at a random time, or has always been sending in a recording
    of `repeated_s` [s]. There is `ambient` light [kcps/SPAD].
    """
    at_m = range_of(signal) if range_m is None else range_m
    zones = _Zones(stress, signal, rng, ids, at_m, repeated_s, ambient, path)
    recording = zones.run(zones.lasting_s)
    if stress.no_target:
        recording = _lose_targets(recording, zones.light, stress.no_target, rng)
    return Sent(recording, zones.own, zones.start_s, zones.packet_s, zones.seconds)


def record_at(
    range_m: float,
    rng: np.random.Generator,
    stress: Stress = PLAIN,
    *,
    size_m: float = MARKER_SIZE_M,
    yaw_deg: float = 0.0,
    **how: Any,
) -> Sent:
    """Return frames of markers of a size [m] at a distance [m], else as `record` has it."""
    signal = float(received_signal(np.array(range_m), size_m**2, math.radians(yaw_deg)))
    return record(stress, signal, rng, range_m=range_m, **how)


def dark(sent: Sent, where: NDArray[np.bool_], rng: np.random.Generator) -> Sent:
    """Return markers of which nothing but the wall is seen in some frames and zones."""
    wall = noisy(np.full(sent.recording.signal.shape, WALL_SIGNAL), NOISE, rng)
    signal = np.where(where, wall, sent.recording.signal).astype(np.float32)
    return sent._replace(recording=replace(sent.recording, signal=signal))
