# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What one recording of lone or repeating packets is put through, in every zone alike.

A marker in the middle of every zone is as bright as wanted, over a wall at its own distance. The
light of all zones is computed at once; what happens to light comes first, then the sensor's
noise that belongs to it, then what the sensor does to its samples. Parts of a stress add up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.link import SILENCE_BITS
from evaluation.bench.stress import HAND_DISTANCE_M, HAND_SIGNAL, lose_dark
from evaluation.bench.transmissions import transmission
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene.description import SIGNAL_AT_1_M, Noise, Occlusion
from retrolidar_ros.scene.noise import deviating, noisy
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT
from retrolidar_ros.scene.reference import NOISE, RANGING, RESPONSE, WALL_SIGNAL
from retrolidar_ros.scene.transmission import visible_share
from retrolidar_ros.sensor.frame import Floats, Recording, Status, ZoneGrid

PERIOD_S = 0.021
SECOND_CLOCK_ERROR = 0.01
"""Largest relative error of a second marker's clock."""
WANDER_S = 0.5
"""Time in which a wandering wall goes its share of the bright signal."""
_WAKING_BITS = PACKET_BITS  # a marker wakes at a random time within as many
_TAIL_BITS = PACKET_BITS  # after the last packet
_ABNORMAL = np.array(
    [Status.NOT_UPDATED, Status.SIGNAL_TOO_LOW_ON_ARRAY, Status.SIGMA_TOO_HIGH, 4, 7, 8, 11],
    dtype=np.uint8,
)
_GARBAGE_SIGNAL, _GARBAGE_DISTANCE_M = 100.0, 4.0


@dataclass(frozen=True)
class Stress:
    """What a recording is put through; what is not named is harmless."""

    name: str
    sway: float = 0.0
    """The marker's light rises and falls by this share of it."""
    sway_s: float = 1.0
    """Period of that [s]."""
    second: float = 0.0
    """Light of another marker in the same zone that repeats, over that of the first."""
    occlusion: Occlusion | None = None
    wander: float = 0.0
    """How far the wall's signal walks in `WANDER_S`, as a share of the bright signal."""
    pedestal: float = 0.0
    """Signal that is added everywhere [kcps/SPAD]."""
    clip: float = math.inf
    """No signal is above this share of marker and wall."""
    hand_s: float = 0.0
    """How long a hand hides the marker, in the middle of its packet [s]."""
    clock_error: float = 0.0
    """Relative error of the marker's bit period."""
    bright_s: float = RESPONSE.bright_s
    """Time in which the liquid crystal brightens [s]."""
    noise: float = 1.0
    """Variance of the signal over that of the reference."""
    no_target: float = 0.0
    """Share of the dark samples that are reported as no target."""
    abnormal: float = 0.0
    """Share of samples with an abnormal status and meaningless values."""
    lost: float = 0.0
    """Share of frames that never arrive."""


PLAIN = Stress('plain')
STRESSES = (
    PLAIN,
    Stress('sways ±50 % in 2.6 s', sway=0.5, sway_s=2.6),
    Stress('sways ±50 % in 0.9 s', sway=0.5, sway_s=0.9),
    *(Stress(f'second marker {share:.0%}', second=share) for share in (0.1, 0.25, 0.5, 0.7)),
    Stress('clipped at 70 %', clip=0.7),
    Stress('wall wanders', wander=0.1),
    Stress('clock -3 %', clock_error=-0.03),
    Stress('clock +3 %', clock_error=0.03),
    Stress('brightens in 20 ms', bright_s=0.020),
    Stress('pedestal of 40', pedestal=40.0),
    Stress('20 % lost', lost=0.2),
    Stress('20 % abnormal', abnormal=0.2),
    Stress('half of dark no target', no_target=0.5),
    Stress('hand for 250 ms', hand_s=0.25),
    Stress('occluded as drone', occlusion=Occlusion(every_s=1.7, lasting_s=0.06)),
    Stress('noise variance / 8', noise=1 / 8),
    Stress('noise variance × 8', noise=8.0),
    Stress('sways ±25 % in 2.6 s', sway=0.25, sway_s=2.6),
    Stress('sways ±25 % in 0.9 s', sway=0.25, sway_s=0.9),
)


class Sent(NamedTuple):
    """A recording, and what the markers of its zones sent."""

    recording: Recording
    ids: NDArray[np.int64]
    """Shape (zones,)."""
    start_s: Floats
    """Of the first packet in each zone, shape (zones,)."""
    packet_s: float
    """How long a packet takes."""
    seconds: NDArray[np.int64] | None
    """IDs of the second markers, shape (zones,)."""


def snr_db(signal: float, noise: float = 1.0) -> float:
    """Return c over sigma of a bright signal [kcps/SPAD], the noise taken at its half [dB]."""
    variance = noise * (NOISE.floor + NOISE.slope * (WALL_SIGNAL + signal / 2))
    return 20 * math.log10(signal / math.sqrt(variance))


def range_of(signal: float) -> float:
    """Return the distance [m] at which a marker of 3 cm is so bright [kcps/SPAD]."""
    return float((signal / SIGNAL_AT_1_M) ** (1 / DISTANCE_EXPONENT))


def _walk(shape: tuple[int, int], bound: float, step: float, rng: np.random.Generator) -> Floats:
    """Return walks from anywhere between 0 and a bound, which reflect there."""
    walked = np.cumsum(step * rng.standard_normal(shape), axis=0) + rng.uniform(0, bound, shape[1])
    reflected: Floats = bound - np.abs(walked % (2 * bound) - bound)
    return reflected


def _hidden(edges_s: Floats, middle_s: Floats, lasting_s: float) -> Floats:
    """Return the share of each exposure in which something hides each marker."""
    bounded = np.clip(edges_s[:, None] - middle_s, -lasting_s / 2, lasting_s / 2)
    share: Floats = np.diff(bounded, axis=0) / np.diff(edges_s)[:, None]
    return share


def _lose_targets(
    recording: Recording, light: Recording, share: float, rng: np.random.Generator
) -> Recording:
    """Report no target in a share of the dark samples, and mark the first target after it."""
    lost = lose_dark(recording, light, share, rng)
    none = lost.status == Status.NO_TARGET
    lost.status[1:][~none[1:] & none[:-1]] = Status.NO_PREVIOUS_TARGET
    return lost


def _garble(recording: Recording, share: float, rng: np.random.Generator) -> None:
    """Make a share of the samples meaningless, with an abnormal status (in place)."""
    hit = rng.random(recording.signal.shape) < share
    count = np.count_nonzero(hit)
    recording.signal[hit] = _GARBAGE_SIGNAL * rng.random(count)
    recording.distance[hit] = _GARBAGE_DISTANCE_M * rng.random(count)
    recording.status[hit] = rng.choice(_ABNORMAL, count)


def _lose_frames(recording: Recording, share: float, rng: np.random.Generator) -> Recording:
    """Drop a share of the frames."""
    kept = rng.random(len(recording)) >= share
    arrays = ('stamp_ns', 'sequence', 'sensor_time_us', 'distance', 'signal', 'ambient', 'status')
    return replace(recording, **{name: getattr(recording, name)[kept] for name in arrays})


def _frames(signal: Floats, range_m: Floats, grid: ZoneGrid) -> Recording:
    """Return frames without noise of signals [kcps/SPAD] at ranges [m], shape (frames, zones)."""
    sequence = np.arange(len(signal))
    time_us = np.rint((sequence + 0.5) * PERIOD_S * 1e6).astype(np.int64)
    return Recording(
        stamp_ns=time_us * 1000,
        sequence=sequence,
        sensor_time_us=time_us,
        grid=grid,
        distance=(range_m * grid.z_per_range).astype(np.float32),
        signal=signal.astype(np.float32),
        ambient=np.zeros(signal.shape, dtype=np.float32),
        status=np.full(signal.shape, Status.VALID, dtype=np.uint8),
    )


def record(
    stress: Stress,
    signal: float,
    rng: np.random.Generator,
    ids: NDArray[np.int64],
    *,
    range_m: float | None = None,
    repeated_s: float | None = None,
    grid: ZoneGrid = ZoneGrid(),
) -> Sent:
    """Return frames of a marker in the middle of every zone.

    Parameters
    ----------
    stress : Stress
        What they are put through.
    signal : float
        Of the bright markers, without the wall [kcps/SPAD].
    rng : numpy.random.Generator
        Where IDs, starts and everything else come from.
    ids : array of int, shape (n,)
        What IDs are drawn from, no fewer than zones.
    range_m : float or None
        Of markers and walls [m]; None = where a marker of 3 cm is so bright.
    repeated_s : float or None
        How long the recording is [s], of markers that have always been sending; None = each
        sends one packet, at a random time.
    grid : ZoneGrid
        The sensor's zones.

    Raises
    ------
    ValueError
        If there are fewer IDs than zones.
    """
    zones = grid.zones
    if len(ids) < zones:
        raise ValueError(f'{len(ids)} IDs for {zones} zones, each with a marker of its own')
    bit_s = BIT_PERIOD_S * (1 + stress.clock_error)
    packet_s = PACKET_BITS * bit_s
    own = rng.choice(ids, zones, replace=False)
    if repeated_s is None:
        start_s = BIT_PERIOD_S * (SILENCE_BITS + _WAKING_BITS * rng.random(zones))
        lasting_s = float(start_s.max()) + packet_s + _TAIL_BITS * BIT_PERIOD_S
        packets = 1.0
    else:
        start_s, lasting_s, packets = -packet_s * rng.random(zones), repeated_s, math.inf
    edges_s = PERIOD_S * np.arange(round(lasting_s / PERIOD_S) + 1)
    middle_s = (edges_s[1:, None] + edges_s[:-1, None]) / 2
    shape = (len(middle_s), zones)
    response = Response(RESPONSE.dark_s, stress.bright_s)
    light = signal * transmission(edges_s, own, start_s, np.full(zones, bit_s), response, packets)
    if stress.sway:
        phase = rng.uniform(0, 2 * math.pi, zones)
        light *= 1 + stress.sway * np.sin(2 * math.pi / stress.sway_s * middle_s + phase)
    if stress.occlusion is not None:
        shifted_s = middle_s + stress.occlusion.every_s * (1 + rng.random(zones))
        light *= visible_share(stress.occlusion, shifted_s, PERIOD_S)
    seconds = None
    if stress.second:
        # Any ID but that of the first marker of the zone.
        places = np.searchsorted(ids, own)
        seconds = ids[(places + rng.integers(1, len(ids), zones)) % len(ids)]
        second_bit_s = BIT_PERIOD_S * (1 + SECOND_CLOCK_ERROR * rng.uniform(-1, 1, zones))
        begun_s = -PACKET_BITS * second_bit_s * rng.random(zones)
        shares = transmission(edges_s, seconds, begun_s, second_bit_s, response, math.inf)
        light += stress.second * signal * shares
    light += WALL_SIGNAL + stress.pedestal
    if stress.wander:
        step = stress.wander * signal * math.sqrt(PERIOD_S / WANDER_S)
        light += _walk(shape, signal / 2, step, rng)
    ranges_m: Floats = np.full(shape, range_of(signal) if range_m is None else range_m)
    if stress.hand_s:
        hidden = _hidden(edges_s, start_s + packet_s / 2, stress.hand_s)
        hand, light = hidden * HAND_SIGNAL, (1 - hidden) * light
        ranges_m[hand > light] = HAND_DISTANCE_M
        light += hand
    np.minimum(light, stress.clip * (signal + WALL_SIGNAL), out=light)
    clean = _frames(light, ranges_m, grid)
    law = Noise(floor=stress.noise * NOISE.floor, slope=stress.noise * NOISE.slope)
    distance = deviating(clean.distance.astype(np.float64), light, RANGING, rng)
    recording = replace(
        clean,
        signal=noisy(light, law, rng).astype(np.float32),
        distance=distance.astype(np.float32),
    )
    if stress.no_target:
        recording = _lose_targets(recording, clean, stress.no_target, rng)
    if stress.abnormal:
        _garble(recording, stress.abnormal, rng)
    if stress.lost:
        recording = _lose_frames(recording, stress.lost, rng)
    return Sent(recording, own, start_s, packet_s, seconds)
