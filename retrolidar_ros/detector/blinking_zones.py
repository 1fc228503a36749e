# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which zones blink, how strongly, and with which bit period, without any parameter.

What blinks with a clock changes at multiples of a bit only. So the squares of the steps from one
sample to the next have a line in their spectrum at one over the bit period (Oerder and Meyr,
1988), whatever is sent; squared second differences have it where all edges fall into the middle
of exposures, and the first ones do not. Of bits shorter than two frames it is an alias (`trials`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector.blinking import Samples, modulation_db
from retrolidar_ros.sensor.frame import Floats, Recording
from retrolidar_ros.sensor.noise import NoiseLaw

BLINKING_DB = 3.0
"""Minimum modulation of a blinking zone: noise alone may reach less [dB]."""
MIN_FRAMES = 64
"""Frames that a bit period is estimated from."""
# A bit is sought that lasts so many frames at most; there is no line where it lasts less than two.
_MAX_FRAMES = 9
# A line of noise is 1 high on average; this is less than what one in thousands of them reaches.
_NOISE_LINE = 8.0
_WEAKEST_FIRST = 0.1  # of the strongest of its lines is the first one of a true period
_APART = 0.03
_CANDIDATES = 4
SURE = 10.0
"""Minimum strength of a spectral line that is not noise."""
_SPANS = (1, 2, 4)  # frames that are averaged: the more, the fainter and slower what is found


class Period(NamedTuple):
    """A possible bit period of a blinking zone."""

    bit_period_s: float
    strength: float
    """By how much its lines exceed those of noise, whose mean is 1; from 10 on it is one."""


class BlinkingZone(NamedTuple):
    """A zone whose signal varies beyond noise."""

    zone: int
    modulation_db: float
    """The SNR of a marker with this variation [dB]."""
    contrast: float
    """Its variation as a share of its largest signal."""
    periods: tuple[Period, ...]
    """Possible bit periods, likeliest first; empty if there is no bit clock."""

    @property
    def is_clocked(self) -> bool:
        """Whether it has a bit clock."""
        return bool(self.periods) and self.periods[0].strength >= SURE


def blinking_zones(recording: Recording, law: NoiseLaw) -> list[BlinkingZone]:
    """Return the zones that vary more than noise in two or more frames, strongest first."""
    samples = Samples.of(recording)
    blinking = modulation_db(samples, law)
    mean = samples.signal.sum(axis=0) / np.maximum(samples.valid.sum(axis=0), 1)
    swing = 10 ** (blinking / 20) * np.sqrt(law.variance(mean))
    order = np.argsort(-blinking)
    return [
        BlinkingZone(
            zone,
            float(blinking[zone]),
            float(swing[zone] / (mean[zone] + swing[zone] / 2)),
            bit_periods(recording, samples, zone),
        )
        for zone in order[blinking[order] >= BLINKING_DB].tolist()
    ]


def bit_periods(recording: Recording, samples: Samples, zone: int) -> tuple[Period, ...]:
    """Return the possible bit periods of a zone, likeliest first; none for too few frames."""
    if len(recording) < MIN_FRAMES:
        return ()
    time_s = recording.stamp_ns * 1e-9
    step_s = np.diff(time_s)
    usual_s = np.median(step_s)
    if step_s.min() < 0 or not usual_s:  # the replay restarted, or the clock stands still
        return ()
    number = np.cumsum(np.concatenate([[0], np.maximum(np.rint(step_s / usual_s), 1)]))
    if number[-1] > 4 * len(number):  # a pause: frames are not on one time grid
        return ()
    frame = number.astype(np.intp)
    period_s = (time_s[-1] - time_s[0]) / frame[-1]
    signal = np.zeros(frame[-1] + 1)
    valid = np.zeros(len(signal), dtype=bool)
    signal[frame], valid[frame] = samples.signal[:, zone], samples.valid[:, zone]
    found: list[Period] = []
    for span in _SPANS:
        found += _periods(*_spectrum(signal, valid, span), span, float(period_s))
    best: list[Period] = []
    for period in sorted(found, key=lambda period: -period.strength):
        if all(abs(period.bit_period_s / one.bit_period_s - 1) > _APART for one in best):
            best.append(period)
    return tuple(best[:_CANDIDATES])


def _spectrum(signal: Floats, valid: NDArray[np.bool_], span: int) -> tuple[Floats, Floats]:
    """Return frequencies [cycles a frame] and power of squared differences of means of a span."""
    total = np.concatenate([[0.0], np.cumsum(signal * valid)])
    count = np.concatenate([[0], np.cumsum(valid)])
    number = count[span:] - count[:-span]
    mean = (total[span:] - total[:-span]) / np.maximum(number, 1)
    known = 2 * number > span
    size = 8 << len(signal).bit_length()
    power = np.zeros(size // 2 + 1)
    for energy, both in (
        ((mean[span:] - mean[:-span]) ** 2, known[span:] & known[:-span]),
        (
            (mean[2 * span :] - 2 * mean[span:-span] + mean[: -2 * span]) ** 2,
            known[2 * span :] & known[span:-span] & known[: -2 * span],
        ),
    ):
        if not both.any():
            continue
        change = np.where(both, energy - energy[both].mean(), 0.0)
        power += np.abs(np.fft.rfft(change, size)) ** 2 / max(change @ change, 1e-30)
    return np.arange(len(power)) / size, power


def _periods(frequency: Floats, power: Floats, span: int, period_s: float) -> list[Period]:
    """Return the bit periods whose lines, with their harmonics, are the strongest."""
    last = len(power) - 1
    lines = np.arange(2 * last // _MAX_FRAMES, int(2 * last / max(1.5 * span, 2.0)) + 1)
    strongest = power[lines].copy()
    strength = strongest - _NOISE_LINE
    for harmonic in range(2, _MAX_FRAMES // 2 + 1):
        index = lines * harmonic
        inside = index <= last
        strength[inside] += power[index[inside]] - _NOISE_LINE
        strongest[inside] = np.maximum(strongest[inside], power[index[inside]])
    strength[power[lines] < _WEAKEST_FIRST * strongest] = -np.inf
    found = []
    for _ in range(_CANDIDATES):
        best = int(strength.argmax())
        if not strength[best] > 0:
            break
        found.append(Period(period_s / float(frequency[lines[best]]), float(strength[best])))
        strength[np.abs(lines / lines[best] - 1) < _APART] = -np.inf
    return found
