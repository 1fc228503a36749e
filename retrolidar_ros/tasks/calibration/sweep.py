# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Zone pitch and blur, from a marker that is swept across the view.

While a marker crosses the border of two zones its light moves from one to the other. How long that
takes, against how long it takes from border to border, is the width of its spot in zones: that of
the marker itself, smeared by the optics. A sweep is to be even: its place is a parabola of time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.scene.optics import line_shares
from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.tasks.calibration.crystal import Sent
from retrolidar_ros.tasks.calibration.estimate import Estimate

_WINDOW_BITS = 6  # in which a marker's light in each zone is measured
_LEAST_BORDERS = 2
_SEEN = 0.3  # of its most light, that a marker is within the view
_LEAST_WINDOWS = 6
_ROUNDS = 25
_STEP = 1e-4
_UNEVEN = 0.01  # of its speed, by which a sweep is off
_BLURS = (0.005, 0.6)
_MODEL_ERROR = 0.01  # of the light


class Sweep(NamedTuple):
    """What a sweep shows of the optics."""

    blur: Estimate
    """Standard deviation of the blur, as a share of a zone's width."""
    pitch: Estimate | None
    """Width of a zone as a tangent; None unless the marker's speed is known."""
    passes: int


class _Pass(NamedTuple):
    """A marker on its way across rows or columns."""

    time_s: Floats
    """Middle of each window, from the middle of the pass on, shape (windows,)."""
    light: Floats
    """Of the marker in each row or column [kcps/SPAD], shape (windows, steps)."""
    noise: Floats
    """Standard deviation of that, of the same shape."""
    path: Floats
    """Place in steps, as coefficients of a parabola of the time, the highest first."""


def sweep_of(
    recording: Recording,
    sent: Sent,
    readings: Sequence[Detection],
    size_m: float,
    speed_m_s: float | None = None,
) -> Sweep | None:
    """Return what a marker shows that moved across the view; None if too little.

    Parameters
    ----------
    recording : Recording
    sent : Sent
        What it sent.
    readings : sequence of Detection
        Of it.
    size_m : float
        Its edge [m].
    speed_m_s : float, optional
        How fast it was moved, straight across the view [m/s].
    """
    depth_m = float(np.median([one.place.position_m[2] for one in readings]))
    window_s = _WINDOW_BITS * sent.bit_period_s.value
    time_s, light, noise = _in_windows(recording, sent, window_s)
    spot = size_m / depth_m / recording.grid.pitch
    shape = (len(time_s), recording.grid.rows, recording.grid.columns)
    found = []
    for axis in (1, 2):
        along = light.reshape(shape).sum(axis=axis)
        sure = np.sqrt((noise.reshape(shape) ** 2).sum(axis=axis))
        found += [_fit(one, spot, window_s) for one in _passes(time_s, along, sure)]
    if not found:
        return None
    pitch = None
    if speed_m_s is not None:
        tangent_s = speed_m_s / depth_m
        pitch = _mean([rate.inverse(tangent_s) for _, rate in found])
        pitch = Estimate(pitch.value, math.hypot(pitch.stddev, _UNEVEN * pitch.value))
    return Sweep(_mean([blur for blur, _ in found]), pitch, len(found))


def _mean(values: Sequence[Estimate]) -> Estimate:
    """Return the weighted mean, no more certain than the values agree."""
    value, stddev = np.array(values).T
    weight = stddev**-2
    mean = float(weight @ value / weight.sum())
    excess = float(weight @ (value - mean) ** 2) / max(len(values) - 1, 1)
    return Estimate(mean, math.sqrt(max(excess, 1.0) / float(weight.sum())))


def _in_windows(recording: Recording, sent: Sent, window_s: float) -> tuple[Floats, Floats, Floats]:
    """Return times, and light of the marker with its deviation in each zone, window by window."""
    time_s = (recording.stamp_ns - recording.stamp_ns[0]) * 1e-9
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    signal = recording.signal.astype(np.float64)
    known = np.flatnonzero(np.isfinite(sent.light))
    times, lights, noises = [], [], []
    for begin_s in np.arange(time_s[known[0]], time_s[known[-1]] - window_s, window_s):
        rows = known[(time_s[known] >= begin_s) & (time_s[known] < begin_s + window_s)]
        seen = sent.light[rows][:, None]
        use = valid[rows]
        count = np.maximum(use.sum(axis=0), 1)
        change = (seen - (seen * use).sum(axis=0) / count) * use
        energy = (change * change).sum(axis=0)
        if energy.min() < 1:
            continue
        gain = (change * signal[rows]).sum(axis=0) / energy
        left = (signal[rows] - (signal[rows] * use).sum(axis=0) / count - gain * change) * use
        variance = (left * left).sum(axis=0) / np.maximum(count - 2, 1)
        times.append(begin_s + window_s / 2)
        lights.append(gain)
        noises.append(np.sqrt(np.maximum(variance, 0.1) / energy))
    return np.array(times), np.array(lights), np.array(noises)


def _passes(time_s: Floats, light: Floats, noise: Floats) -> list[_Pass]:
    """Return the stretches in which a marker crosses borders one after the other, one way."""
    if len(time_s) < 3:
        return []
    steps = light.shape[1]
    total = light.sum(axis=1)
    ordered = np.cumsum(light, axis=1) / np.maximum(total, 1e-9)[:, None]
    # So that noise lets it cross a border but once.
    ordered[1:-1] = (ordered[2:] + ordered[1:-1] + ordered[:-2]) / 3
    seen = total[1:] > _SEEN * total.max()
    crossings = []  # when, at which border, and to which side
    for border in range(1, steps):
        before = ordered[:, border - 1] - 0.5
        for index in np.flatnonzero((before[1:] * before[:-1] < 0) & seen):
            share = before[index] / (before[index] - before[index + 1])
            when = time_s[index] + share * (time_s[index + 1] - time_s[index])
            crossings.append((when, border, 1 if before[index] > 0 else -1))
    crossings.sort()
    runs: list[list[tuple[float, int, int]]] = []
    for one in crossings:
        last = runs[-1][-1] if runs else None
        if last is not None and last[2] == one[2] and one[1] == last[1] + one[2]:
            runs[-1].append(one)
        else:
            runs.append([one])
    found = []
    for run in runs:
        if len(run) < _LEAST_BORDERS:
            continue
        when, border = np.array([one[:2] for one in run]).T
        middle_s = (when[0] + when[-1]) / 2
        margin_s = 0.4 * (when[-1] - when[0]) / (len(run) - 1)
        inside = (time_s > when[0] - margin_s) & (time_s < when[-1] + margin_s)
        if np.count_nonzero(inside) < _LEAST_WINDOWS:
            continue
        path = np.polyfit(when - middle_s, border, min(len(run) - 1, 2))
        path = np.concatenate([np.zeros(3 - len(path)), path])
        doubt = np.hypot(noise[inside], _MODEL_ERROR * total[inside, None])
        found.append(_Pass(time_s[inside] - middle_s, light[inside], doubt, path))
    return found


def _fit(one: _Pass, spot: float, window_s: float) -> tuple[Estimate, Estimate]:
    """Return the blur, and how many zones are crossed in a second.

    Parameters
    ----------
    one : _Pass
    spot : float
        Width of the marker, in widths of a zone.
    window_s : float
        In which its light was measured [s]: it is smeared by its way in that time.
    """
    steps = one.light.shape[1]
    free = [1, 2, 3] if one.path[0] == 0 else [0, 1, 2, 3]

    def missed(values: Floats) -> Floats:
        place = np.polyval(values[:3], one.time_s)
        speed = np.polyval(np.polyder(values[:3]), one.time_s)
        # A smear of even width and the blur add up as variances do.
        blur = np.sqrt(values[3] ** 2 + (speed * window_s) ** 2 / 12)
        width = np.full_like(place, spot)
        share = line_shares(place - steps / 2, width, steps, 1.0, blur[:, None])
        strength = (share * one.light / one.noise**2).sum(axis=1)
        strength /= np.maximum((share**2 / one.noise**2).sum(axis=1), 1e-12)
        left: Floats = (one.light - strength[:, None] * share) / one.noise
        return left.ravel()

    values = np.array([*one.path, 0.08])
    damping = 1e-2
    left = missed(values)
    for _ in range(_ROUNDS):
        slopes = np.stack(
            [(missed(values + _STEP * np.eye(4)[i]) - left) / _STEP for i in free], axis=-1
        )
        normal = slopes.T @ slopes
        scaled = normal + damping * np.diag(np.diag(normal) + 1e-9)
        trial = values.copy()
        trial[free] -= np.linalg.solve(scaled, slopes.T @ left)
        trial[3] = np.clip(trial[3], *_BLURS)
        after = missed(trial)
        if after @ after < left @ left:
            values, left, damping = trial, after, damping / 5
        else:
            damping *= 10
    freedom = max(len(left) - len(one.time_s) - len(free), 1)
    covariance = np.linalg.pinv(normal) * max(float(left @ left) / freedom, 1.0)
    deviation = np.zeros(4)
    deviation[free] = np.sqrt(np.maximum(np.diag(covariance), 1e-12))
    rate = Estimate(abs(float(values[1])), float(deviation[1]))
    return Estimate(float(values[3]), float(deviation[3])), rate
