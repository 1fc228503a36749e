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
from numpy.typing import NDArray

from retrolidar_ros.detector.detection import Detection
from retrolidar_ros.scene.optics import line_shares
from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.tasks.calibration.crystal import Sent, slopes
from retrolidar_ros.tasks.calibration.estimate import Estimate, least_squares

_WINDOW_BITS = 6  # in which a marker's light in each zone is measured
_LEAST_BORDERS = 2
_SEEN = 0.3  # of its most light, that a marker is within the view
_LEAST_WINDOWS = 6
_STEP = 1e-4
_UNEVEN = 0.01  # of its speed, by which a sweep is off
_BLURS = (0.005, 0.6)
_MOST_DARK = 2.0
_MODEL_ERROR = 0.004  # of the light
_DEPTH_ERROR_M = 0.02
_BLUR_SEEN = 0.03


class Sweep(NamedTuple):
    """What a sweep shows of the optics."""

    blur: Estimate
    """Standard deviation of the blur, as a share of a zone's width."""
    pitch: Estimate | None
    """Width of a zone as a tangent; None unless the marker's speed is known."""
    passes: int


class _Windows(NamedTuple):
    """Light of a marker, measured in one window of time after the other."""

    time_s: Floats
    """Their middles, shape (windows,)."""
    light: Floats
    """Of the marker in each zone, shape (windows, zones) [kcps/SPAD]."""
    variance: Floats
    """Of that, of the same shape."""
    frame_s: Floats
    """Times of the frames, shape (frames,)."""
    parts: Floats
    """What a marker in each frame adds to it: as far as it is bright, and in itself; shape
    (windows, 2, frames).
    """


def sweep_of(
    recording: Recording,
    sent: Sent,
    readings: Sequence[Detection],
    law: NoiseLaw,
    size_m: float,
    speed_m_s: float | None = None,
) -> Sweep | None:
    """Return what a marker shows that moved across the view; None if too little.

    Its edge is `size_m` [m], and it moved straight at `speed_m_s` [m/s], as far as is known.
    """
    depth_m = float(np.median([one.place.position_m[2] for one in readings]))
    windows = _in_windows(recording, sent, law)
    grid = recording.grid
    spot = size_m / depth_m / grid.pitch
    found = []
    for axis in (1, 2):
        light, variance = (
            of.reshape(-1, grid.rows, grid.columns).sum(axis=axis)
            for of in (windows.light, windows.variance)
        )
        along = windows._replace(light=light, variance=variance)
        found += [_fit(along, *one, spot) for one in _passes(along)]
    if not found:
        return None
    blur = _mean([blur for blur, _ in found])
    # Squares of blur and spot add up, and the spot is as uncertain as the depth.
    unsure = spot**2 / 12 * _DEPTH_ERROR_M / depth_m / max(blur.value, _BLUR_SEEN)
    blur = Estimate(blur.value, math.hypot(blur.stddev, unsure))
    pitch = None
    if speed_m_s is not None:
        pitch = _mean([rate.inverse(speed_m_s / depth_m) for _, rate in found])
        pitch = Estimate(pitch.value, math.hypot(pitch.stddev, _UNEVEN * pitch.value))
    return Sweep(blur, pitch, len(found))


def _mean(values: Sequence[Estimate]) -> Estimate:
    """Return the weighted mean, no more certain than the values agree."""
    value, stddev = np.array(values).T
    weight = stddev**-2
    mean = float(weight @ value / weight.sum())
    excess = float(weight @ (value - mean) ** 2) / max(len(values) - 1, 1)
    return Estimate(mean, math.sqrt(max(excess, 1.0) / float(weight.sum())))


def _in_windows(recording: Recording, sent: Sent, law: NoiseLaw) -> _Windows:
    """Return the light of the marker in each zone, by least squares, window by window."""
    window_s = _WINDOW_BITS * sent.bit_period_s.value
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    known = np.isfinite(sent.light)
    time_s = (recording.stamp_ns[known] - recording.stamp_ns[0]) * 1e-9
    signal, seen, valid = (
        recording.signal[known].astype(np.float64),
        sent.light[known],
        valid[known],
    )
    rows = []
    for begin_s in np.arange(time_s[0], time_s[-1] - window_s, window_s):
        inside = (time_s >= begin_s) & (time_s < begin_s + window_s)
        use = valid & inside[:, None]
        weights, energy = slopes(seen, use)
        if energy.min() >= 1:
            light = (weights * signal).sum(axis=0)
            noise = (weights**2 * law.variance(signal)).sum(axis=0)
            # All zones alike: they lack no more than single samples.
            parts = weights.mean(axis=1)
            rows.append((begin_s + window_s / 2, light, noise, (parts * seen, parts)))
    columns = [np.array(column) for column in zip(*rows, strict=True)] or [np.zeros((0, 0))] * 4
    middle_s, light, variance, parts = columns
    return _Windows(middle_s, light, variance, time_s, parts)


def _passes(windows: _Windows) -> list[tuple[NDArray[np.bool_], Floats]]:
    """Return which windows are of a marker on its way over borders, and its path.

    The path is in steps: coefficients of a polynomial of the time, the highest first.
    """
    time_s, light = windows.time_s, windows.light
    if len(time_s) < _LEAST_WINDOWS:
        return []
    total = light.sum(axis=1)
    ordered = np.cumsum(light, axis=1) / np.maximum(total, 1e-9)[:, None]
    # So that noise lets it cross a border but once.
    ordered[1:-1] = (ordered[2:] + ordered[1:-1] + ordered[:-2]) / 3
    seen = total[1:] > _SEEN * total.max()
    crossings = []  # when, at which border, and to which side
    for border in range(1, light.shape[1]):
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
        margin_s = 0.4 * (when[-1] - when[0]) / (len(run) - 1)
        inside = (time_s > when[0] - margin_s) & (time_s < when[-1] + margin_s)
        if np.count_nonzero(inside) >= _LEAST_WINDOWS:
            found.append((inside, np.polyfit(when, border, min(len(run) - 1, 2))))
    return found


def _fit(
    windows: _Windows, inside: NDArray[np.bool_], path: Floats, spot: float
) -> tuple[Estimate, Estimate]:
    """Return the blur, and how many zones are crossed in a second, of a pass.

    It is `inside` some windows and begins with a guess of its path; the spot is in zones.
    """
    light, variance, parts = windows.light[inside], windows.variance[inside], windows.parts[inside]
    frames = parts.any(axis=(0, 1))
    parts, frame_s = parts[..., frames], windows.frame_s[frames]
    steps = light.shape[1]
    middle_s = frame_s.mean()
    path = np.poly1d(path)(np.poly1d([1.0, middle_s])).coeffs
    weight = 1 / (variance + (_MODEL_ERROR * light.sum(axis=1, keepdims=True)) ** 2)
    width = np.full(len(frame_s), spot)

    def missed(values: Floats) -> Floats:
        *path, dark, blur = values
        place = np.polyval(path, frame_s - middle_s) - steps / 2
        share = (parts[:, 0] + dark * parts[:, 1]) @ line_shares(place, width, steps, 1.0, blur)
        strength = (share * light * weight).sum(axis=1) / (share**2 * weight).sum(axis=1)
        left: Floats = (light - strength[:, None] * share) * np.sqrt(weight)
        return left.ravel()

    # What a dark marker still reflects, over the rest of its light, moves with it.
    free = np.full(len(path), np.inf)
    bounds = np.append(-free, (0.0, _BLURS[0])), np.append(free, (_MOST_DARK, _BLURS[1]))
    start = np.append(path, (0.0, 0.08))
    freedom = light.size - len(light) - len(start)
    _, found = least_squares(missed, start, np.full(len(start), _STEP), bounds, freedom)
    *_, speed, _, _, blur = found
    return blur, Estimate(abs(speed.value), speed.stddev)
