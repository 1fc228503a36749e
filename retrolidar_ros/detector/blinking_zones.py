# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Which zones blink, how strongly, and with which bit period, without any parameter.

What blinks with a clock changes at multiples of a bit only. So the squares of the steps from one
sample to the next have a line in their spectrum at one over the bit period (Oerder and Meyr,
1988), whatever is sent. Of bits shorter than two frames it is an alias (`trials`).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.sensor.frame import Floats, Recording, valid_samples
from retrolidar_ros.sensor.model import NoiseLaw

BLINKING_DB = 3.0  # minimum modulation of a blinking zone: noise alone may reach less [dB]
MIN_FRAMES = 64  # frames that a bit period is estimated from
_MAX_FRAMES = 9  # of a bit; there is no line where it lasts less than two
_NOISE_LINE = 4.0  # on average a line of noise is 1 high; one in hundreds is higher
_WEAKEST_FIRST = 0.1  # of the strongest of its lines is the first one of a true period
_APART = 0.03
_CANDIDATES = 4
SURE = 5.0  # minimum strength of a spectral line that is not noise
_PHASES = np.arange(8) / 8  # tried: ends of the last bit, and clock errors
_CLOCKS = 1 + 0.007 * np.arange(-4, 5)
_MIN_VALID = 0.5  # minimum number of valid samples of a bit, of two; with fewer it is erased


def valid_signal(recording: Recording) -> tuple[Floats, NDArray[np.bool_], Floats]:
    """Return signals, 0 of an erasure, which are valid, and the mean of these by zone."""
    valid, _ = valid_samples(recording.signal, recording.distance, recording.status)
    signal = np.where(valid, recording.signal, 0.0)
    return signal, valid, signal.sum(axis=0) / np.maximum(valid.sum(axis=0), 1)


def modulation_db(recording: Recording, law: NoiseLaw) -> Floats:
    """Return the variation of zones beyond noise as an SNR [dB], shape (zones,); -inf for none.

    It is that of a marker that would cause it: half of its bits are dark, so an amplitude of c
    makes a variance of c²/4. A passing hand makes one, too.
    """
    signal, valid, mean = valid_signal(recording)
    noise = law.variance(mean)
    deviation = (signal - mean) * valid
    variance = (deviation**2).sum(axis=0) / np.maximum(valid.sum(axis=0), 1)
    with np.errstate(divide='ignore'):
        decibels: Floats = 10 * np.log10(4 * np.maximum(variance - noise, 0.0) / noise)
    return decibels


class Period(NamedTuple):
    """A possible bit period of a blinking zone."""

    bit_period_s: float
    strength: float  # by how much its lines exceed those of noise; from `SURE` on it is one


class BlinkingZone(NamedTuple):
    """A zone whose signal varies beyond noise."""

    zone: int
    modulation_db: float  # the SNR of a marker with this variation [dB]
    contrast: float  # its variation as a share of its largest signal
    periods: tuple[Period, ...]  # possible ones, likeliest first; empty without a bit clock

    @property
    def is_clocked(self) -> bool:
        """Whether it has a bit clock."""
        return bool(self.periods) and self.periods[0].strength >= SURE


def blinking_zones(recording: Recording, law: NoiseLaw) -> list[BlinkingZone]:
    """Return the zones that vary more than noise in two or more frames, strongest first."""
    blinking = modulation_db(recording, law)
    signal, valid, mean = valid_signal(recording)
    swing = 10 ** (blinking / 20) * np.sqrt(law.variance(mean))
    order = np.argsort(-blinking)
    return [
        BlinkingZone(
            zone,
            float(blinking[zone]),
            float(swing[zone] / (mean[zone] + swing[zone] / 2)),
            bit_periods(recording.stamp_ns, signal[:, zone], valid[:, zone]),
        )
        for zone in order[blinking[order] >= BLINKING_DB].tolist()
    ]


def bit_periods(
    stamp_ns: NDArray[np.int64], signal: Floats, valid: NDArray[np.bool_]
) -> tuple[Period, ...]:
    """Return the possible bit periods of a zone, likeliest first; arrays are of shape (frames,)."""
    if len(stamp_ns) < MIN_FRAMES:
        return ()
    step_s = np.diff(stamp_ns) * 1e-9
    usual_s = np.median(step_s)
    if step_s.min() < 0 or not usual_s:  # the replay restarted, or the clock stands still
        return ()
    frame = np.cumsum(np.concatenate([[0], np.maximum(np.rint(step_s / usual_s), 1)])).astype(int)
    if frame[-1] > 4 * len(frame):  # a pause: frames are not on one time grid
        return ()
    energy = np.zeros(frame[-1])  # of the steps between neighbours on that grid
    known = np.flatnonzero((np.diff(frame) == 1) & valid[1:] & valid[:-1])
    energy[frame[known]] = np.diff(signal)[known] ** 2
    energy[frame[known]] -= energy[frame[known]].mean() if len(known) else 0.0
    last = 4 << len(energy).bit_length()
    power = np.abs(np.fft.rfft(energy, 2 * last)) ** 2 / max(energy @ energy, 1e-30)
    period_s = float(stamp_ns[-1] - stamp_ns[0]) * 1e-9 / frame[-1]
    lines = _strongest_lines(power)
    return tuple(Period(2 * last * period_s / line, strength) for line, strength in lines)


def _strongest_lines(power: Floats) -> list[tuple[int, float]]:
    """Return indices of the spectral lines that are the strongest with their harmonics."""
    last = len(power) - 1
    lines = np.arange(2 * last // _MAX_FRAMES, last + 1)
    strongest = power[lines].copy()
    strength = strongest - _NOISE_LINE
    for harmonic in range(2, _MAX_FRAMES // 2 + 1):
        index = lines * harmonic
        inside = index <= last
        strength[inside] += power[index[inside]] - _NOISE_LINE
        strongest[inside] = np.maximum(strongest[inside], power[index[inside]])
    strength[power[lines] < _WEAKEST_FIRST * strongest] = -np.inf
    found: list[tuple[int, float]] = []
    while len(found) < _CANDIDATES and strength.max() > 0:
        best = int(strength.argmax())
        found.append((int(lines[best]), float(strength[best])))
        strength[np.abs(lines / lines[best] - 1) < _APART] = -np.inf
    return found


class NewestBits(NamedTuple):
    """The last 31 bits that a zone saw, oldest first."""

    signal: Floats  # mean of each bit [kcps/SPAD], NaN where it was erased, shape (31,)
    dark: float  # mean of the darker bits [kcps/SPAD]
    bright: float  # mean of the brighter bits [kcps/SPAD]

    @property
    def erased(self) -> NDArray[np.bool_]:
        """Which bits are erased, shape (31,)."""
        return np.isnan(self.signal)

    @property
    def hard(self) -> NDArray[np.bool_]:
        """Whether each bit is nearer to dark: a bit 1; shape (31,)."""
        return self.signal < (self.bright + self.dark) / 2


def newest_bits(recording: Recording, zone: int, bit_period_s: float) -> NewestBits | None:
    """Return a zone's last bits, cut where they vary most; None if too few, or all alike.

    It takes two frames or more; an exposure lasts a frame period.
    """
    seen, valid, _ = valid_signal(recording)
    time_s = (recording.stamp_ns - recording.stamp_ns[0]) * 1e-9
    period_s = float(np.median(np.diff(time_s)))
    begin_s, end_s = time_s - period_s / 2, time_s + period_s / 2
    bit_s, phase = (grid.ravel() for grid in np.meshgrid(bit_period_s * _CLOCKS, _PHASES))
    # Shape (alignments, bits + 1).
    edge_s = end_s[-1] - bit_s[:, None] * (phase[:, None] + np.arange(PACKET_BITS, -1, -1))
    # Share of each exposure in each bit, shape (alignments, bits, samples).
    begin = np.maximum(begin_s, edge_s[:, :-1, None])
    end = np.minimum(end_s, edge_s[:, 1:, None])
    share = np.maximum(end - begin, 0.0) / period_s * valid[:, zone]
    count = share.sum(axis=-1)
    means = np.full(count.shape, np.nan)
    np.divide(share @ seen[:, zone], count, out=means, where=count > _MIN_VALID)
    known = ~np.isnan(means)
    number = np.maximum(known.sum(axis=-1), 1)
    change = means - (np.nansum(means, axis=-1) / number)[:, None]
    best = int((np.nansum(change**2, axis=-1) / number).argmax())
    signal, known = means[best], known[best]
    if np.count_nonzero(known) < PACKET_BITS // 2 or not np.ptp(signal[known]):
        return None
    is_bright = signal[known] > (signal[known].min() + signal[known].max()) / 2
    levels = (float(signal[known][one].mean()) for one in (~is_bright, is_bright))
    return NewestBits(signal, *levels)
