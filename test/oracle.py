# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The three questions of the detector in plain numpy: what the core has to agree with.

Samples are x = a + g·T + l + n: white noise n of variance s, a level l that walks at random with
variance q·s a frame period, and a of any value (local level model: Harvey 1989). One likelihood
answers all: is something there (`evidence`), is it a word (`word`), and is it this one (`margin`)?
Each zone has a, g, s and q of its own; the likelihoods of zones are multiplied. Other packets that
are known of have a gain each, fitted along, with any template or none.
"""

import itertools
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from retrolidar_ros.marker.code import PACKET_BITS
from retrolidar_ros.scene.description import Response
from retrolidar_ros.sensor.frame import Floats

WALKS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 30.0)
"""Values of q that are tried."""
FLIPS = 4
"""So many bits are turned to make a better sequence of a word."""
ID_BITS = 12
PARTS = 11
"""Of the window of a packet, between which a marker may appear or vanish."""
ABSENCE = 6.0
"""What it costs that a marker appears or vanishes just then [nats]."""


class Sending(NamedTuple):
    """What a marker sends, and when."""

    bits: Floats
    """1 = dark, shape (31,)."""
    repeats: bool
    """Back to back without end; a lone packet is bright before and after."""
    start_s: float
    bit_s: float


class Fit(NamedTuple):
    """How well a zone's samples are explained."""

    log_likelihood: float
    gain: float
    """g [kcps/SPAD]; 0 where the packet explains nothing."""


def light(sending: Sending, begin_s: Floats, end_s: Floats) -> Floats:
    """Return the mean transmission during exposures, 0 to 1; all of shape (exposures,)."""
    bit_s = sending.bit_s
    level: Floats = 1.0 - np.asarray(sending.bits, dtype=np.float64)
    if sending.repeats:
        cycles = (np.array([begin_s[0], end_s[-1]]) - sending.start_s) / (PACKET_BITS * bit_s)
        first, last = np.floor(cycles).astype(int)
        level = np.tile(level, last - first + 1)
        before: Floats = np.roll(level, 1)
        lasting_s: Floats = np.full(len(level), bit_s)
    else:
        first = 0
        before = np.append(1.0, level)
        level = np.append(level, 1.0)
        lasting_s = np.append(np.full(PACKET_BITS, bit_s), np.inf)
    start_s = sending.start_s + bit_s * (first * PACKET_BITS + np.arange(len(level)))
    response = Response(0.0005, 0.0035)

    def until(time_s: Floats) -> Floats:
        in_bit_s = np.clip(time_s[:, None] - start_s, 0.0, lasting_s)
        before_s = np.minimum(time_s - start_s[0], 0.0)
        total: Floats = before_s + response.integral(before, level, in_bit_s).sum(axis=1)
        return total

    return (until(end_s) - until(begin_s)) / (end_s - begin_s)


class Zone:
    """The valid samples of a zone in a window, whitened for every walk."""

    def __init__(
        self, begin_s: Floats, end_s: Floats, signal: Floats, *, period_s: float, least: float
    ) -> None:
        """Take exposures [s] and signals [kcps/SPAD], all of shape (samples,).

        Parameters
        ----------
        period_s : float
            Of the frames, in which a level walks by q·s [s].
        least : float
            Variance of the noise that there is at least [(kcps/SPAD)²].
        """
        self.times = (begin_s, end_s)
        self._interferers: list[Floats] = []
        self._signal = signal
        self._least = least
        samples = len(signal)
        middle_s = (begin_s + end_s) / 2
        since = (middle_s - middle_s[:1]) / period_s
        # The offset is unknown, so only differences to the first sample tell something.
        difference = np.eye(samples)[1:]
        difference[:, :1] = -1.0
        self._whitening = []
        for walk in WALKS:
            covariance = np.eye(samples) + walk * np.minimum.outer(since, since)
            factor = np.linalg.cholesky(difference @ covariance @ difference.T)
            white = np.linalg.solve(factor, difference)
            log_scale = -float(np.log(np.diag(factor)).sum())
            self._whitening.append((white, log_scale))

    def add_interferer(self, template: Floats) -> None:
        """Fit another packet's light along from now on, shape (samples,)."""
        self._interferers.append(template)

    def _without_interferers(self, white: Floats) -> tuple[Floats, list[Floats]]:
        """Return the innovations that interferers leave over, and their orthonormal templates."""
        left: Floats = white @ self._signal
        basis: list[Floats] = []
        for template in self._interferers:
            column = white @ template
            column -= sum((column @ other) * other for other in basis)
            if column @ column > 1e-9:
                basis.append(column / np.linalg.norm(column))
                left = left - (left @ basis[-1]) * basis[-1]
        return left, basis

    def _fit(self, squares: float, log_scale: float, gain: float, parameters: int) -> Fit:
        """Return the likelihood of innovations whose sum of squares is left over."""
        count = len(self._signal) - 1
        parameters += len(self._interferers)
        variance = max(squares / max(count - parameters, 1), self._least)
        likelihood = log_scale - 0.5 * count * np.log(variance) - 0.5 * squares / variance
        return Fit(float(likelihood), gain)

    def fit_light(self, template: Floats | None) -> Fit:
        """Return the best fit of all walks; a template has a positive gain, or none."""
        fits = []
        for white, scale in self._whitening:
            x, basis = self._without_interferers(white)
            fits.append(self._fit(float(x @ x), scale, 0.0, 0))
            if template is None or len(self._signal) < 3:
                continue
            t = white @ template
            t -= sum((t @ other) * other for other in basis)
            if x @ t > 0 and t @ t > 1e-9:
                gain = float(x @ t / (t @ t))
                left = max(float(x @ x - gain * (x @ t)), 0.0)
                fits.append(self._fit(left, scale, gain, 1))
        return max(fits)

    def fit_knots(self, template: Floats, weights: Floats) -> float:
        """Return the log likelihood of a template whose gain is linear between knots.

        No gain is negative, so all sets of knots are tried. How much of each sample is on a knot is
        given, of shape (samples, knots).
        """
        knots = weights.shape[1]
        best = self.fit_light(None).log_likelihood
        for white, scale in self._whitening:
            x, basis = self._without_interferers(white)
            t = white @ (template[:, None] * weights)
            t -= sum(np.outer(other, other @ t) for other in basis)
            for count in range(1, knots + 1):
                for chosen in itertools.combinations(range(knots), count):
                    gains = np.linalg.lstsq(t[:, chosen], x, rcond=None)[0]
                    left = x - t[:, chosen] @ gains
                    if (gains >= 0).all():
                        fit = self._fit(float(left @ left), scale, 0.0, knots)
                        best = max(best, fit.log_likelihood)
        return best

    def fit(self, sending: Sending | None) -> Fit:
        """Return the best fit of what is sent, or of nothing."""
        return self.fit_light(None if sending is None else light(sending, *self.times))


def log_likelihood(zones: Iterable[Zone], sending: Sending | None) -> float:
    """Return the log likelihood of what is sent, or of nothing [nats]."""
    return sum(zone.fit(sending).log_likelihood for zone in zones)


def evidence(zones: Sequence[Zone], sending: Sending) -> float:
    """Return by how much a packet is likelier than anything that just wanders [nats]."""
    return log_likelihood(zones, sending) - log_likelihood(zones, None)


def word(zones: Sequence[Zone], sending: Sending) -> float:
    """Return by how much another sequence of bits is likelier, found by turning one at a time."""
    own = best = log_likelihood(zones, sending)
    for _ in range(FLIPS):
        turned = [sending._replace(bits=np.abs(sending.bits - one)) for one in np.eye(PACKET_BITS)]
        likelihoods = [log_likelihood(zones, other) for other in turned]
        if max(likelihoods) <= best:
            break
        best = max(likelihoods)
        sending = turned[int(np.argmax(likelihoods))]
    return best - own


def margin(zones: Sequence[Zone], sending: Sending, others: Iterable[Sending]) -> float:
    """Return by how much a packet is likelier than the likeliest of others [nats]."""
    own = log_likelihood(zones, sending)
    return own - max(log_likelihood(zones, other) for other in others)


def sequence_margin(
    zones: Sequence[Zone], sending: Sending, begin_s: float, others: Sequence[Floats]
) -> float:
    """Return by how much a packet is likelier than the end of one and the beginning of another.

    These are lone packets of any of the others' bits, the second of which begins with a bit after
    `begin_s` [s]. The bits of an ID that are seen of the first might be any: a choice of two each.
    """
    best = -math.inf
    for bits in range(1, PACKET_BITS):
        second_s = begin_s + bits * sending.bit_s
        first_s = second_s - PACKET_BITS * sending.bit_s
        for ended, begun in itertools.product(others, repeat=2):
            first = sending._replace(bits=ended, repeats=False, start_s=first_s)
            second = sending._replace(bits=begun, repeats=False, start_s=second_s)
            found = sum(
                zone.fit_light(
                    np.maximum(light(first, *zone.times) + light(second, *zone.times) - 1, 0)
                ).log_likelihood
                for zone in zones
            )
            best = max(best, found - math.log(2) * min(bits, ID_BITS))
    return log_likelihood(zones, sending) - best


def part_margin(
    zones: Sequence[Zone], sending: Sending, rows_s: Floats, others: Sequence[Floats]
) -> float:
    """Return by how much a packet is likelier than others of a marker that appears or vanishes.

    A marker that is not there is as dark as with a dark bit. It may come or go between any two
    parts of the window, whose rows begin at `rows_s` [s].
    """

    def seen(one: Sending, split_s: float, later: bool) -> float:
        return sum(
            zone.fit_light(
                np.where((zone.times[0] >= split_s) == later, light(one, *zone.times), 0)
            ).log_likelihood
            for zone in zones
        )

    rivals = [
        sending._replace(bits=bits, start_s=sending.start_s + bit * sending.bit_s)
        for bits, bit in itertools.product(others, range(PACKET_BITS))
    ]
    likelihood = max(
        seen(rival, rows_s[part * len(rows_s) // PARTS], later)
        for rival, part, later in itertools.product(rivals, range(1, PARTS), (False, True))
    )
    return ABSENCE + log_likelihood(zones, sending) - likelihood
