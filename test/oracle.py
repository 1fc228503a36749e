# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The three questions of the detector in plain numpy: what the core has to agree with.

Samples are x = a + g·T + l + n: white noise n of variance s, a level l that walks at random with
variance q·s a frame period, a of any value (local level model: Harvey 1989). One likelihood
answers all: is there a packet (`evidence`), is it a word (`word`), and is it this one (`margin`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from retrolidar_ros.code import PACKET_BITS
from retrolidar_ros.frame import Floats
from retrolidar_ros.liquid_crystal import Response

WALKS = (0.0, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 30.0)


class Samples(NamedTuple):
    """Valid samples of a zone in a window, each field of shape (samples,)."""

    begin_s: Floats
    end_s: Floats
    signal: Floats


def light(
    samples: Samples,
    bits: Floats,
    start_s: float,
    bit_s: float,
    *,
    repeats: bool = False,
    brightening_s: float = 0.0035,
) -> Floats:
    """Return the mean transmission during each exposure, by integrating finely, (samples,)."""
    fine = 2000
    step_s = bit_s / fine
    cycles = 3 if repeats else 1
    sent = np.tile(1.0 - bits, cycles)
    idle = 1.0 - bits[-1] if repeats else 1.0
    level = np.concatenate([[idle], sent, [sent[0] if repeats else 1.0]])
    response = Response(bright_s=brightening_s)
    since_s = (np.arange(fine) + 0.5) * step_s
    shape = (len(level) - 1, fine)
    before = np.broadcast_to(level[:-1, None], shape)
    after = np.broadcast_to(level[1:, None], shape)
    transmission = response.relaxation(before, after, np.broadcast_to(since_s, shape))[1].ravel()
    first_s = start_s - (PACKET_BITS * bit_s if repeats else 0.0)
    edges_s = first_s + step_s * np.arange(len(transmission) + 1)
    total = np.concatenate([[0.0], np.cumsum(transmission) * step_s])

    def until(time_s: Floats) -> Floats:
        inside: Floats = np.interp(time_s, edges_s, total)
        outside: Floats = time_s - np.clip(time_s, edges_s[0], edges_s[-1])
        return inside + outside

    mean: Floats = (until(samples.end_s) - until(samples.begin_s)) / (
        samples.end_s - samples.begin_s
    )
    return mean


def log_likelihood(
    samples: Samples, template: Floats | None, period_s: float, least: float
) -> float:
    """Return the best log likelihood of all walks; `least` is the least variance of the noise."""
    middle_s = (samples.begin_s + samples.end_s) / 2
    apart = np.diff(middle_s) / period_s
    count = len(middle_s)
    best = -np.inf
    for walk in WALKS:
        # Innovations of differences: the covariance of x[k] - x[0] is that of noise and walk.
        until = np.concatenate([[0.0], np.cumsum(apart)])
        covariance = np.eye(count) + walk * np.minimum.outer(until, until)
        difference = np.hstack([-np.ones((count - 1, 1)), np.eye(count - 1)])
        factor = np.linalg.cholesky(difference @ covariance @ difference.T)
        white = np.linalg.solve(factor, difference @ samples.signal)
        log_scale = -np.log(np.diag(factor)).sum()
        squares, free = float(white @ white), 0
        if template is not None:
            sent = np.linalg.solve(factor, difference @ template)
            if not (white @ sent > 0 and sent @ sent > 1e-9):
                continue
            squares, free = squares - float(white @ sent) ** 2 / float(sent @ sent), 1
        variance = max(squares / (count - 1 - free), least)
        likelihood = log_scale - 0.5 * (count - 1) * np.log(variance) - 0.5 * squares / variance
        best = max(best, float(likelihood))
    return best
