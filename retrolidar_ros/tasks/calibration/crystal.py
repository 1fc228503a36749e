# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a marker that was read is like: its clock, its crystal, and its light in each zone.

All its packets in a recording are fitted at once: the samples of a zone are a level and a gain
times the mean transmission of each exposure, which follows from when the packets began, how long
a bit lasts, and how fast the crystal darkens and brightens. By Levenberg and Marquardt; weights are
those of the sensor's noise at each level.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.transmission import Transmission
from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.tasks.calibration.estimate import Estimate

_MOST_ZONES = 4
_LEAST_SHARE = 0.15  # of the strongest zone's gain, that a zone is used
_SEEN = 0.02  # of it, that a zone counts as one that sees the marker
# Bits by which packets of one train may be off, from one to the next and from all.
_SAME_TRAIN, _SAME_PACKETS = 0.45, 0.3
_ROUNDS = 12
_OUTLIER = 5.0  # standard deviations
_LEAST_S = 5e-5  # a faster response is not distinguished from none
_STEPS_S = np.array([1e-7, 2e-5, 5e-5, 5e-5])  # of bit, start, darkening and brightening
# What darkening is expected to be, where a recording does not show it: it is driven (paper §2.2).
_DARK_S = Estimate(0.0005, 0.0005)
_PRIOR = np.array([0.0, 0.0, _DARK_S.stddev**-2, 0.0])
_EXPECTED = np.array([0.0, 0.0, _DARK_S.value, 0.0])
_LEAST = np.array([0.0, -np.inf, _LEAST_S, _LEAST_S])
_ENOUGH = 1e-3

Seen = Callable[[Floats, Floats], Floats]
"""From values of the four parameters and times to the mean light of exposures."""


class Sent(NamedTuple):
    """What a marker sent, and how its crystal followed."""

    id: int
    bit_period_s: Estimate
    start_s: float
    """When a packet began, after the first frame."""
    dark_s: Estimate
    """From 10 to 90 %."""
    bright_s: Estimate
    light: Floats
    """Mean transmission of each exposure, 0 to 1, NaN before and after; shape (frames,)."""
    zones: tuple[int, ...]
    """Strongest first."""
    level: dict[int, Estimate]
    """Signal of a dark crystal in each of them [kcps/SPAD]."""
    gain: dict[int, Estimate]
    """By how much a bright one exceeds it [kcps/SPAD]."""
    total: float
    """The same, of all zones that see it together [kcps/SPAD]."""
    flips: float
    """Share of dark samples at another distance than bright ones: something behind is seen."""
    packets: int


class _Samples(NamedTuple):
    time_s: Floats
    signal: Floats
    valid: NDArray[np.bool_]


def train_of(readings: Sequence[Detection], origin_ns: int) -> tuple[float, float, int]:
    """Return bit period [s], start of the first packet [s] and packets of a marker's readings.

    A repeating marker's packets begin a whole number of packets apart; where they do not, only
    those since the last pause are used, or before it, whichever are more.
    """
    start_s = np.array([(one.start_ns - origin_ns) * 1e-9 for one in readings])
    order = np.argsort(start_s)
    start_s = start_s[order]
    bit_s = float(np.median([one.bit_period_s for one in readings]))
    trains: list[list[tuple[int, float]]] = []
    for start in start_s.tolist():
        if trains:
            number, last = trains[-1][-1]
            packets = round((start - last) / (PACKET_BITS * bit_s))
            error_s = start - last - packets * PACKET_BITS * bit_s
            if abs(error_s) < _SAME_TRAIN * bit_s * max(packets, 1):
                trains[-1].append((number + packets, start))
                continue
        trains.append([(0, start)])
    longest = max(trains, key=len)
    number, begin = np.array(longest).T
    if number[-1] == 0:
        return bit_s, float(begin[0]), 1
    line = np.polyfit(number, begin, 1)
    near = np.abs(begin - np.polyval(line, number)) < _SAME_PACKETS * bit_s
    if np.ptp(number[near]) > 0:
        line = np.polyfit(number[near], begin[near], 1)
    return float(line[0]) / PACKET_BITS, float(line[1]), int(number[-1]) + 1


def fit_crystal(recording: Recording, readings: Sequence[Detection], law: NoiseLaw) -> Sent:
    """Return what one marker sent, from its readings and all samples of the zones that saw it.

    Parameters
    ----------
    recording : Recording
    readings : sequence of Detection
        All of one ID, at least one.
    law : NoiseLaw
        Of the sensor, in the light of the recording.
    """
    origin_ns = int(recording.stamp_ns[0])
    bit_s, start_s, packets = train_of(readings, origin_ns)
    time_s = (recording.stamp_ns - origin_ns) * 1e-9
    exposure_s = float(np.median(np.diff(time_s)))
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    end_s = start_s + packets * PACKET_BITS * bit_s
    rows = (time_s > start_s + exposure_s) & (time_s < end_s - exposure_s)
    signal = recording.signal.astype(np.float64)
    identity = readings[0].id

    def light(values: Floats, at_s: Floats) -> Floats:
        bit, start, dark, bright = values.tolist()
        response = Response(max(dark, 0.0), max(bright, 0.0))
        marker = Marker(
            identity, (0.0, 0.0, 1.0), '', bit_period_s=bit, start_s=start, response=response
        )
        return Transmission(marker).mean(at_s, exposure_s)

    values = np.array([bit_s, start_s, _DARK_S.value, 0.1 * bit_s])
    shape = light(values, time_s[rows])
    gains = _gains(shape, signal[rows], valid[rows])
    order = np.argsort(-gains)
    zones = [int(z) for z in order[:_MOST_ZONES] if gains[z] > _LEAST_SHARE * gains[order[0]]]
    samples = _Samples(time_s[rows], signal[rows][:, zones], valid[rows][:, zones])
    # The middle of the samples is where the start is known best, whatever the bit period.
    lever = (samples.time_s.mean() - start_s) / bit_s

    def seen(parameters: Floats, at_s: Floats) -> Floats:
        bit, middle, dark, bright = parameters.tolist()
        return light(np.array([bit, middle - lever * bit, dark, bright]), at_s)

    values[1] += lever * bit_s
    values, linear, deviation = _fit(seen, values, samples, law, bit_s)
    whole = np.full(len(time_s), np.nan)
    whole[rows] = seen(values, samples.time_s)
    all_gains = _gains(whole[rows], signal[rows], valid[rows])
    count = len(zones)
    return Sent(
        id=identity,
        bit_period_s=Estimate(float(values[0]), float(deviation[0])),
        start_s=float(values[1] - lever * values[0]),
        dark_s=Estimate(float(values[2]), float(deviation[2])),
        bright_s=Estimate(float(values[3]), float(deviation[3])),
        light=whole,
        zones=tuple(zones),
        level={
            zone: Estimate(float(linear[0, i]), float(deviation[4 + i]))
            for i, zone in enumerate(zones)
        },
        gain={
            zone: Estimate(float(linear[1, i]), float(deviation[4 + count + i]))
            for i, zone in enumerate(zones)
        },
        total=float(all_gains[all_gains > _SEEN * all_gains.max()].sum()),
        flips=_flips(recording.distance[:, zones[0]], valid[:, zones[0]], whole),
        packets=packets,
    )


def _gains(light: Floats, signal: Floats, valid: NDArray[np.bool_]) -> Floats:
    """Return by how much each zone's signal rises with the light, shape (zones,)."""
    count = np.maximum(valid.sum(axis=0), 1)
    change = (light[:, None] - light @ valid / count) * valid
    gains: Floats = (change * signal).sum(axis=0) / np.maximum((change * change).sum(axis=0), 1e-9)
    return gains


def _fit(
    seen: Seen, values: Floats, samples: _Samples, law: NoiseLaw, bit_s: float
) -> tuple[Floats, Floats, Floats]:
    """Return values of the four parameters, (2, zones) levels and gains, and all deviations."""
    zones = samples.signal.shape[1]
    most = np.array([np.inf, np.inf, bit_s / 2, bit_s / 2])
    damping = 1e-3
    light = seen(values, samples.time_s)
    linear, weight, cost, excess = _linear(light, samples, law, values)
    for _ in range(_ROUNDS):
        slopes = np.stack(
            [
                (seen(values + step, samples.time_s) - seen(values - step, samples.time_s))
                / (2 * step.max())
                for step in np.diag(_STEPS_S)
            ],
            axis=-1,
        )
        normal, gradient = _normal(light, slopes, linear, weight, samples, zones)
        normal[:4, :4] += np.diag(_PRIOR)
        gradient[:4] += _PRIOR * (_EXPECTED - values)
        scale = np.sqrt(np.diag(normal))
        scaled = normal / np.outer(scale, scale)
        step = np.linalg.solve(scaled + damping * np.eye(len(scale)), gradient / scale) / scale
        trial = np.clip(values + step[:4], _LEAST, most)
        trial_light = seen(trial, samples.time_s)
        found = _linear(trial_light, samples, law, trial)
        if found[2] >= cost:
            damping *= 10
            continue
        small = cost - found[2] < _ENOUGH
        values, light, (linear, weight, cost, excess) = trial, trial_light, found
        damping /= 5
        if small:
            break
    covariance = np.linalg.inv(scaled) / np.outer(scale, scale)
    return values, linear, np.sqrt(np.diag(covariance) * max(excess, 1.0))


def _linear(
    light: Floats, samples: _Samples, law: NoiseLaw, values: Floats
) -> tuple[Floats, Floats, float, float]:
    """Return levels and gains that fit best, the samples' weights, the cost, and χ² a sample."""
    weight = samples.valid / law.variance(np.full_like(samples.signal, samples.signal.mean()))
    for _ in range(3):
        total = np.maximum(weight.sum(axis=0), 1e-12)
        mean_light = light @ weight / total
        mean_signal = (weight * samples.signal).sum(axis=0) / total
        change = light[:, None] - mean_light
        energy = np.maximum((weight * change**2).sum(axis=0), 1e-12)
        gain = (weight * change * (samples.signal - mean_signal)).sum(axis=0) / energy
        level = mean_signal - gain * mean_light
        fitted = level + gain * light[:, None]
        variance = law.variance(fitted)
        error = np.maximum((samples.signal - fitted) ** 2 / variance, 1e-12)
        weight = samples.valid * np.minimum(_OUTLIER**2 / error, 1.0) / variance
    squared = samples.valid * np.minimum(error, _OUTLIER**2)
    # The logarithm holds the variances of different levels against each other.
    cost = float(
        (squared + samples.valid * np.log(variance)).sum() + _PRIOR @ (values - _EXPECTED) ** 2
    )
    excess = float(squared.sum() / max(np.count_nonzero(samples.valid), 1))
    return np.stack([level, gain]), weight, cost, excess


def _normal(
    light: Floats, slopes: Floats, linear: Floats, weight: Floats, samples: _Samples, zones: int
) -> tuple[Floats, Floats]:
    """Return the normal equations of four parameters and of levels and gains."""
    size = 4 + 2 * zones
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for zone in range(zones):
        jacobian = np.zeros((len(light), size))
        jacobian[:, :4] = linear[1, zone] * slopes
        jacobian[:, 4 + zone] = 1.0
        jacobian[:, 4 + zones + zone] = light
        left = samples.signal[:, zone] - linear[0, zone] - linear[1, zone] * light
        weighed = jacobian * weight[:, zone, None]
        normal += weighed.T @ jacobian
        gradient += weighed.T @ left
    return normal, gradient


def _flips(distance: Floats, valid: NDArray[np.bool_], light: Floats) -> float:
    """Return the share of dark samples whose distance is not that of bright ones."""
    with np.errstate(invalid='ignore'):
        bright, dark = valid & (light > 0.9), valid & (light < 0.1)
    if not bright.any() or not dark.any():
        return 0.0
    about = np.nanmedian(distance[bright])
    return float(np.mean(~(np.abs(distance[dark] - about) < 0.3)))
