# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of markers under stress: the one mechanism by which most experiments make frames.

A marker stands in the middle of every zone, or one marker goes its way through all of them. The
light of all zones is computed at once; what happens to light comes first, then the sensor's
noise that belongs to it, then what the sensor does to its samples.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.stresses import Stress
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.marker.known_markers import MARKER_SIZE_M
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene.description import SIGNAL_AT_1_M, Noise, SecondSensor
from retrolidar_ros.scene.laboratory import second_light
from retrolidar_ros.scene.noise import deviating, noisy
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, zone_shares
from retrolidar_ros.scene.reference import NOISE, RANGING, RESPONSE, SENSOR, WALL_SIGNAL
from retrolidar_ros.scene.transmission import visible_share
from retrolidar_ros.sensor.frame import Floats, Recording, Status

HAND_SIGNAL, HAND_DISTANCE_M = 1700.0, 0.2  # [kcps/SPAD]
SILENCE_BITS = 40  # before a lone packet: 1.7 s
SECOND_CLOCK_ERROR = 0.01  # largest relative error of a second marker's clock
WANDER_S = 0.5  # time in which a wandering wall goes its share of the bright signal
FAR_WALL_M = 1.0  # how far a wall that is separated stands behind the marker
GLASS_M = 0.01
_BLUR = 0.05  # of what a marker that moves is seen by, in zones
NEIGHBOUR_S = (0.033, 0.011)  # frame period of another sensor, and how long it sends in each
_TAIL_BITS = 16  # after the last packet: a reading of it comes within half a second
_ABNORMAL = np.array(
    [Status.NOT_UPDATED, Status.SIGNAL_TOO_LOW_ON_ARRAY, Status.SIGMA_TOO_HIGH, 4, 7, 8, 11],
    dtype=np.uint8,
)
_GARBAGE_SIGNAL, _GARBAGE_DISTANCE_M = 100.0, 4.0

Path = Callable[[Floats], Floats]  # positions [m], shape (n, 3), at times [s], shape (n,)


class Sent(NamedTuple):
    """A recording, and what its markers sent."""

    recording: Recording
    ids: NDArray[np.int64]  # shape (zones,), or (1,) of one that goes through them
    start_s: Floats  # of the first packet of each marker
    packet_s: float  # how long a packet takes
    seconds: NDArray[np.int64] | None  # IDs of the second markers


def snr_db(signal: float, noise: float = 1.0) -> float:
    """Return c over sigma of a bright signal [kcps/SPAD], the noise taken at its half [dB]."""
    variance = noise * (NOISE.floor + NOISE.slope * (WALL_SIGNAL + signal / 2))
    return 20 * math.log10(signal / math.sqrt(variance))


def signal_at(range_m: float) -> float:
    """Return how bright a marker of 3 cm is at a distance [m], [kcps/SPAD]."""
    return float(SIGNAL_AT_1_M * range_m**DISTANCE_EXPONENT)


def rng_at(seed: int, place: float) -> np.random.Generator:
    """Return a generator that gives the same frames at a place to every experiment."""
    return np.random.default_rng([seed, round(1000 * place)])


def transmission(
    edges_s: Floats,
    ids: NDArray[np.int64],
    start_s: Floats,
    bit_s: Floats,
    response: Response,
    packets: float = 1,
) -> Floats:
    """Return what share of the light markers let through, 0 to 1, shape (frames, markers).

    The edges [s] are the beginnings of the exposures and the end of the last, shape (frames + 1,),
    or both of each, shape (frames, 2). Markers begin their first packets at `start_s`, hold a bit
    for `bit_s`, and send some packets (infinity = without end) before they stay bright.
    """
    levels = 1.0 - packet(ids)
    before = np.roll(levels, 1, axis=1)
    whole = response.integral(before, levels, np.broadcast_to(bit_s[:, None], levels.shape))
    elapsed = np.concatenate([np.zeros((len(ids), 1)), np.cumsum(whole, axis=1)], axis=1)
    # The very first bit follows the bright state of a silent marker.
    excess = response.integral(np.ones(len(ids)), levels[:, 0], bit_s) - whole[:, 0]
    since = edges_s.reshape(-1, 1) - start_s
    bits = np.clip(np.floor(since / bit_s), 0, packets * PACKET_BITS)
    cycles, place = np.divmod(bits, PACKET_BITS)
    index = np.arange(len(ids)), place.astype(np.intp)
    level = np.where(bits == packets * PACKET_BITS, 1.0, levels[index])
    from_level = np.where(bits == 0, 1.0, before[index])
    within = response.integral(from_level, level, np.maximum(since - bits * bit_s, 0.0))
    sent = cycles * elapsed[:, -1] + elapsed[index] + np.where(bits > 0, excess, 0.0) + within
    passed = np.where(since < 0, since, sent).reshape(*edges_s.shape, len(ids))
    axis = edges_s.ndim - 1
    share: Floats = np.diff(passed, axis=axis) / np.diff(edges_s, axis=axis)[..., None]
    return share.reshape(-1, len(ids))


def walk(shape: tuple[int, int], bound: float, step: float, rng: np.random.Generator) -> Floats:
    """Return walks from anywhere between 0 and a bound, which reflect there."""
    walked = np.cumsum(step * rng.standard_normal(shape), axis=0) + rng.uniform(0, bound, shape[1])
    return bound - np.abs(walked % (2 * bound) - bound)


def to_and_fro(distance: Floats, half: float) -> Floats:
    """Return places that go from one end, `half` from the middle, to the other and back."""
    turned: Floats = half - np.abs(distance % (4 * half) - 2 * half)
    return turned


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
    """Return frames of a marker in the middle of every zone, or of one on its way.

    Bright markers have `signal` above the wall [kcps/SPAD], and stand with their walls at `range_m`
    [m], by default where markers of 3 cm are so bright; or the only one is on `path`, and has
    `signal` at `range_m`. Their IDs are drawn from `ids`, shape (n,); ValueError if these are fewer
    than markers. Each sends one packet at a random time, or has always been sending in a recording
    of `repeated_s` [s]. There is `ambient` light [kcps/SPAD].
    """
    zones, period_s = SENSOR.grid.zones, SENSOR.period_s
    markers = zones if path is None else 1
    if len(ids) < markers:
        raise ValueError(f'{len(ids)} IDs for {markers} markers, each with one of its own')
    at_m = (signal / SIGNAL_AT_1_M) ** (1 / DISTANCE_EXPONENT) if range_m is None else range_m
    bit_s = BIT_PERIOD_S * (1 + stress.clock_error)
    packet_s = PACKET_BITS * bit_s
    own = rng.choice(ids, markers, replace=False)
    if repeated_s is None:
        start_s = BIT_PERIOD_S * (SILENCE_BITS + PACKET_BITS * rng.random(markers))
        lasting_s = float(start_s.max()) + packet_s + _TAIL_BITS * BIT_PERIOD_S
        packets = 1.0
    else:
        start_s, lasting_s, packets = -packet_s * rng.random(markers), repeated_s, math.inf
    middle_s = period_s * (np.arange(round(lasting_s / period_s)) + 0.5)
    if stress.jitter_s:
        # Bounded, so that no frame overtakes the next one.
        middle_s += stress.jitter_s * np.clip(rng.standard_normal(len(middle_s)), -2, 2)
    edges_s = middle_s[:, None] + period_s * np.array([-0.5, 0.5])
    shape = (len(middle_s), zones)
    response = Response(RESPONSE.dark_s, stress.bright_s)

    def sent(ids: NDArray[np.int64], start_s: Floats, bit_s: Floats, packets: float) -> Floats:
        return transmission(edges_s, ids, start_s, bit_s, response, packets)

    light = signal * sent(own, start_s, np.full(markers, bit_s), packets)
    if stress.sway:
        turn = 2 * math.pi / stress.sway_s * middle_s[:, None]
        light *= 1 + stress.sway * np.sin(turn + rng.uniform(0, 2 * math.pi, markers))
    if stress.occlusion is not None:
        shifted_s = middle_s[:, None] + stress.occlusion.every_s * (1 + rng.random(markers))
        light *= visible_share(stress.occlusion, shifted_s, period_s)
    seconds = None
    if stress.second:
        # Any ID but that of the first marker of the zone.
        places = np.searchsorted(ids, own)
        seconds = ids[(places + rng.integers(1, len(ids), markers)) % len(ids)]
        second_bit_s = BIT_PERIOD_S * (1 + SECOND_CLOCK_ERROR * rng.uniform(-1, 1, markers))
        begun_s = -PACKET_BITS * second_bit_s * rng.random(markers)
        light += stress.second * signal * sent(seconds, begun_s, second_bit_s, math.inf)
    ranges_m: Floats = np.full(shape, at_m)
    if path is not None:
        position_m = path(middle_s)
        ranges_m = np.repeat(np.linalg.norm(position_m, axis=1)[:, None], zones, axis=1)
        share = zone_shares(position_m, MARKER_SIZE_M, SENSOR.grid, _BLUR)
        light = light * share * (ranges_m / at_m) ** DISTANCE_EXPONENT
    light += WALL_SIGNAL + stress.pedestal
    if stress.wander:
        step = stress.wander * signal * math.sqrt(period_s / WANDER_S)
        light += walk(shape, signal / 2, step, rng)
    if stress.hand_s:
        # The first packet of a lone marker is also its only one.
        from_middle = (middle_s[:, None] - start_s) / packet_s - 0.5
        nearest = 0 if repeated_s is None else np.rint(from_middle)
        bounds_s = packet_s * (from_middle - nearest)[..., None] + period_s * np.array([-0.5, 0.5])
        bounded_s = np.clip(bounds_s, -stress.hand_s / 2, stress.hand_s / 2)
        hidden = (bounded_s[..., 1] - bounded_s[..., 0]) / period_s
        hand = np.broadcast_to(hidden * HAND_SIGNAL, shape)
        light = (1 - hidden) * light
        ranges_m[hand > light] = HAND_DISTANCE_M
        light += hand
    np.minimum(light, stress.clip * (signal + WALL_SIGNAL), out=light)
    if stress.far_wall:
        flipped = light < stress.far_wall * (signal + WALL_SIGNAL)
        light[flipped] = stress.far_wall * (signal + WALL_SIGNAL)
        ranges_m[flipped] += FAR_WALL_M
    ranges_m[light < stress.glass] = GLASS_M
    light = np.maximum(light, stress.glass)
    around: Floats = np.full((len(middle_s), 1), ambient)
    if stress.neighbour:
        sending = SecondSensor(stress.neighbour, *NEIGHBOUR_S)
        around += second_light(sending, middle_s, period_s)[:, None]
    # Ambient light is as noisy as what comes back.
    law = Noise(*(stress.noise * one for one in (NOISE.floor, NOISE.slope, NOISE.slope)))
    distance = deviating(ranges_m * SENSOR.grid.z_per_range, light, RANGING, rng)
    time_us = np.rint(middle_s * 1e6).astype(np.int64)
    recording = Recording(
        stamp_ns=time_us * 1000,
        sequence=np.arange(len(middle_s)),
        sensor_time_us=time_us,
        grid=SENSOR.grid,
        distance=distance.astype(np.float32),
        signal=noisy(light, law, rng, around).astype(np.float32),
        ambient=np.broadcast_to(around, shape).astype(np.float32),
        status=np.full(shape, Status.VALID, dtype=np.uint8),
    )
    if stress.no_target:
        recording = _lose_targets(recording, light, stress.no_target, rng)
    if stress.abnormal:
        hit = rng.random(shape) < stress.abnormal
        count = np.count_nonzero(hit)
        recording.signal[hit] = _GARBAGE_SIGNAL * rng.random(count)
        recording.distance[hit] = _GARBAGE_DISTANCE_M * rng.random(count)
        recording.status[hit] = rng.choice(_ABNORMAL, count)
    if stress.lost:
        kept = rng.random(len(recording)) >= stress.lost
        arrays = {name: values for name, values in vars(recording).items() if name != 'grid'}
        recording = replace(recording, **{name: values[kept] for name, values in arrays.items()})
    return Sent(recording, own, start_s, packet_s, seconds)
