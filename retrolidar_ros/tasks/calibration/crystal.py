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
from collections.abc import Set as AbstractSet
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.scene.transmission import Transmission, exposure_edges
from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.tasks.calibration.estimate import Estimate, least_squares

_MOST_ZONES = 4
_LEAST_SHARE = 0.15  # of the strongest zone's gain, that a zone is used
_SEEN = 0.02  # of it, that a zone counts as one that sees the marker
# Bits by which packets of one train may be off, from one to the next and from all.
_SAME_TRAIN, _SAME_PACKETS = 0.45, 0.3
_WEIGHINGS = 3
_OUTLIER = 5.0  # standard deviations
_LEAST_S = 5e-5  # a faster response is not distinguished from none
_STEPS_S = np.array([1e-7, 2e-5, 5e-5, 5e-5])  # of bit, start, darkening and brightening
DARK_S = Estimate(0.0005, 0.0005)
"""Darkening, as far as a recording does not show it: it is driven (paper §2.2)."""
_LEAST = np.array([0.0, -np.inf, _LEAST_S, _LEAST_S])

Seen = Callable[[Floats], Floats]
"""From values of the four parameters to the mean light of exposures."""


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
    level: Estimate
    """Signal of a dark crystal in the strongest [kcps/SPAD]."""
    gain: Estimate
    """By how much a bright one exceeds it [kcps/SPAD]."""
    total: float
    """The same, of all zones that see it together [kcps/SPAD]."""
    flips: float
    """Share of dark samples at another distance than bright ones: something behind is seen."""


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


def fit_crystal(
    recording: Recording, readings: Sequence[Detection], law: NoiseLaw, others: AbstractSet[int]
) -> Sent:
    """Return what one marker sent, from its readings and all samples of the zones that saw it.

    Parameters
    ----------
    recording : Recording
    readings : sequence of Detection
        All of one ID, at least one.
    law : NoiseLaw
        Of the sensor, in the light of the recording.
    others : set of int
        Zones of other markers, which are left out.
    """
    origin_ns = int(recording.stamp_ns[0])
    bit_s, start_s, packets = train_of(readings, origin_ns)
    time_s = (recording.stamp_ns - origin_ns) * 1e-9
    exposure_s = float(np.median(np.diff(time_s)))
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    valid[:, list(others)] = False
    end_s = start_s + packets * PACKET_BITS * bit_s
    rows = (time_s > start_s + exposure_s) & (time_s < end_s - exposure_s)
    signal = np.where(valid, recording.signal, 0.0).astype(np.float64)[rows]
    # The middle of the samples is where the start is known best, whatever the bit period.
    lever = (time_s[rows].mean() - start_s) / bit_s

    edges_s = exposure_edges(time_s[rows], exposure_s)

    def seen(values: Floats) -> Floats:
        bit, middle, dark, bright = values.tolist()
        begin, response = middle - lever * bit, Response(max(dark, 0.0), max(bright, 0.0))
        return Transmission(packet(readings[0].id), bit, begin, response).mean(edges_s)

    values = np.array([bit_s, start_s + lever * bit_s, DARK_S.value, 0.1 * bit_s])
    shape = seen(values)
    gain = gains(shape, signal, valid[rows])
    order = np.argsort(-gain)
    zones = [int(z) for z in order[:_MOST_ZONES] if gain[z] > _LEAST_SHARE * gain[order[0]]]
    used, use = signal[:, zones], valid[rows][:, zones]
    level = ((used - shape[:, None] * gain[zones]) * use).sum(axis=0) / use.sum(axis=0)
    values = np.concatenate([values, level, gain[zones]])
    values, found = _fit(seen, values, used, use, law)
    whole = np.full(len(time_s), np.nan)
    whole[rows] = seen(values[:4])
    all_gains = gains(whole[rows], signal, valid[rows])
    return Sent(
        id=readings[0].id,
        bit_period_s=found[0],
        start_s=found[1].value - lever * found[0].value,
        dark_s=found[2],
        bright_s=found[3],
        light=whole,
        zones=tuple(zones),
        level=found[4],
        gain=found[4 + len(zones)],
        total=float(all_gains[all_gains > _SEEN * all_gains.max()].sum()),
        flips=_flips(recording.distance[:, zones[0]], valid[:, zones[0]], whole),
    )


def slopes(light: Floats, valid: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Return what samples weigh in the slope of a zone's signal by the light.

    Returns
    -------
    weights : array, shape (frames, zones)
    energy : array, shape (zones,)
        Of the light that was seen.
    """
    change = (light[:, None] - light @ valid / np.maximum(valid.sum(axis=0), 1)) * valid
    energy: Floats = (change * change).sum(axis=0)
    return change / np.maximum(energy, 1e-9), energy


def gains(light: Floats, signal: Floats, valid: NDArray[np.bool_]) -> Floats:
    """Return by how much each zone's signal rises with the light, shape (zones,)."""
    rises: Floats = (slopes(light, valid)[0] * signal).sum(axis=0)
    return rises


def _fit(
    seen: Seen, values: Floats, signal: Floats, valid: NDArray[np.bool_], law: NoiseLaw
) -> tuple[Floats, list[Estimate]]:
    """Return the four parameters, and levels and gains of the zones."""

    def fitted(values: Floats) -> Floats:
        level, gain = values[4:].reshape(2, -1)
        light: Floats = level + gain * seen(values[:4])[:, None]
        return light

    free = np.full(len(values) - 4, np.inf)
    slowest = np.array([np.inf, np.inf, values[0] / 2, values[0] / 2])
    bounds = np.append(_LEAST, -free), np.append(slowest, free)
    steps = np.append(_STEPS_S, np.ones_like(free))
    for _ in range(_WEIGHINGS):
        expected = fitted(values)
        variance = law.variance(expected)
        error = np.maximum((signal - expected) ** 2 / variance, 1e-12)
        root = np.sqrt(valid * np.minimum(_OUTLIER**2 / error, 1.0) / variance)

        def missed(trial: Floats, root: Floats = root) -> Floats:
            left = root * (fitted(trial) - signal)
            return np.append(left.ravel(), (trial[2] - DARK_S.value) / DARK_S.stddev)

        freedom = int(np.count_nonzero(valid))
        values, found = least_squares(missed, values, steps, bounds, freedom)
    return values, found


def _flips(distance: Floats, valid: NDArray[np.bool_], light: Floats) -> float:
    """Return the share of dark samples whose distance is not that of bright ones."""
    with np.errstate(invalid='ignore'):
        bright, dark = valid & (light > 0.9), valid & (light < 0.1)
    if not bright.any() or not dark.any():
        return 0.0
    about = np.nanmedian(distance[bright])
    return float(np.mean(~(np.abs(distance[dark] - about) < 0.3)))
