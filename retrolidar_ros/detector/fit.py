# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Stage 4: the exact fit of candidates: start, clock, gain, offset and what is left over."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from retrolidar_ros.code import PACKET_BITS, packet
from retrolidar_ros.detector.candidates import Candidates
from retrolidar_ros.detector.evidence import NoiseLaw, nats
from retrolidar_ros.detector.template import Light, packet_light
from retrolidar_ros.frame import Floats

_STEPS = 2
_MAX_SHIFT = 0.75  # of a sample, away from where the search has found the packet
# Share of the modulation by which a template may be wrong: the response of another liquid
# crystal, a stamp that is late, a marker that moves.
_TEMPLATE_ERROR = 0.04


class Fit(NamedTuple):
    """Candidates as they fit best, each field of shape (candidates,) or more."""

    start_s: Floats
    bit_s: Floats
    gain: Floats
    """Bright minus dark [kcps/SPAD]."""
    dark: Floats
    """Level of the dark bits in the middle of the packet [kcps/SPAD]."""
    score: Floats
    """Normalised correlation."""
    nats: Floats
    """Logarithm of the likelihood ratio against no packet."""
    samples: Floats
    """How many samples tell, less the parameters that take something off."""
    residual: Floats
    """χ² per degree of freedom against the noise law."""
    deviation: Floats
    """Standard deviation of what is left over [kcps/SPAD]."""
    light: Floats
    """The template, shape (candidates, samples)."""
    expected: Floats
    """What the packet makes of the samples [kcps/SPAD], shape (candidates, samples)."""
    variance: Floats
    """By which these may miss that [(kcps/SPAD)²], shape (candidates, samples)."""
    weight: Floats
    """Which samples tell, shape (candidates, samples)."""


def fit_candidates(
    candidates: Candidates,
    begin_s: Floats,
    end_s: Floats,
    signal: Floats,
    weight: Floats,
    ceiling: Floats,
    law: NoiseLaw,
    noise_scale: float,
) -> Fit:
    """Fit packets to samples by Gauss-Newton steps on start and bit period.

    Parameters
    ----------
    candidates : Candidates
    begin_s, end_s : array, shape (samples,)
        Of the exposures [s].
    signal, weight : array, shape (candidates, samples)
        What each candidate's zone received [kcps/SPAD]; weight 0 for erasures.
    ceiling : array, shape (candidates, samples)
        Where it is not known but that it was less than this [kcps/SPAD]; 0 elsewhere.
    law : NoiseLaw
        Of the sensor.
    noise_scale : float
        How many times that variance the sensor has.
    """
    middle_s = (begin_s + end_s) / 2
    sample_s = candidates.bit_s / 2
    inside = (middle_s >= candidates.begin_s[:, None]) & (middle_s < candidates.end_s[:, None])
    weight = weight * inside
    centre_s = (candidates.begin_s + candidates.end_s) / 2
    line = (middle_s - centre_s[:, None]) / (candidates.end_s - candidates.begin_s)[:, None]
    bits = packet(candidates.ids)
    ones = np.ones_like(line)
    # Fitting about the middle of the packets parts the start from the bit period.
    length = candidates.packets * PACKET_BITS
    middle = (centre_s - candidates.start_s) / candidates.bit_s
    offset = np.where(candidates.repeats, middle, PACKET_BITS / 2)
    nominal_s = candidates.bit_s
    shift: Floats = np.zeros(len(bits))
    stretch: Floats = np.zeros(len(bits))

    def light() -> Light:
        bit_s = nominal_s * (1 + stretch)
        start_s = candidates.start_s + shift + (nominal_s - bit_s) * offset
        return packet_light(bits, start_s, bit_s, candidates.repeats, begin_s, end_s)

    slope = np.where(candidates.still[:, None], 0.0, line)
    columns = np.empty((*weight.shape, 5))
    columns[:, :, 3] = 1.0
    columns[:, :, 4] = slope
    for _ in range(_STEPS):
        seen = light()
        columns[:, :, 0] = seen.mean
        columns[:, :, 1] = seen.per_start
        # With the middle of the packets held, a longer bit is an earlier start, too.
        columns[:, :, 2] = seen.per_bit - seen.per_start * offset[:, None]
        columns[:, :, 1:3] *= nominal_s[:, None, None]
        answer = _least_squares(columns, signal, weight)
        gain = np.maximum(answer[:, 0], 1e-9)
        limit = 0.4 * sample_s
        shift = shift + np.clip(answer[:, 1] / gain * nominal_s, -limit, limit)
        shift = np.clip(shift, -_MAX_SHIFT * sample_s, _MAX_SHIFT * sample_s)
        most = 0.4 / length
        stretch = stretch + np.clip(answer[:, 2] / gain, -most / 2, most / 2)
        stretch = np.clip(stretch, -most, most)
    template = light().mean
    plain = np.stack([ones, slope], axis=-1)
    rest = _without(plain, signal, weight)
    pure = _without(plain, template, weight)
    energy = np.einsum('cn,cn->c', rest, rest)
    pure_energy = np.einsum('cn,cn->c', pure, pure)
    common = np.einsum('cn,cn->c', pure, rest)
    score = common / np.sqrt(np.maximum(energy * pure_energy, 1e-12))
    samples = weight.sum(axis=1) - np.where(candidates.still, 0.0, 1.0)
    best_gain: Floats = common / np.maximum(pure_energy, 1e-12)
    # A marker on the move changes its gain within the packet, too: that is no misfit.
    full = np.stack([template, template * line, ones, line], axis=-1)
    answer = _least_squares(full, signal, weight)
    fitted = np.einsum('cnk,ck->cn', full, answer)
    # Of a marker that was outshone, any level up to what outshone it is no misfit.
    left = np.where(fitted < ceiling, 0.0, signal - fitted) * weight
    variance = noise_scale * law.variance(fitted) + (_TEMPLATE_ERROR * best_gain[:, None]) ** 2
    freedom = np.maximum(weight.sum(axis=1) - 6, 1.0)
    residual = np.einsum('cn,cn->c', left, left / variance) / freedom
    deviation = np.sqrt(np.einsum('cn,cn->c', left, left) / freedom)
    bit_s = nominal_s * (1 + stretch)
    return Fit(
        start_s=candidates.start_s + shift + (nominal_s - bit_s) * offset,
        bit_s=bit_s,
        gain=best_gain,
        dark=answer[:, 2],
        score=score,
        nats=nats(score, samples),
        samples=samples,
        residual=residual,
        deviation=deviation,
        light=template,
        expected=fitted,
        variance=variance,
        weight=weight,
    )


def _least_squares(columns: Floats, signal: Floats, weight: Floats) -> Floats:
    """Solve for the coefficients of columns (candidates, samples, k): shape (candidates, k)."""
    weighted = columns * weight[..., None]
    normal = np.einsum('cnk,cnl->ckl', weighted, columns)
    # A column of zeros gets the coefficient 0.
    size = normal.shape[-1]
    normal += (1e-9 + 1e-9 * np.einsum('ckk->c', normal))[:, None, None] * np.eye(size)
    right = np.einsum('cnk,cn->ck', weighted, signal)
    answer: Floats = np.linalg.solve(normal, right[..., None])[..., 0]
    return answer


def _without(columns: Floats, values: Floats, weight: Floats) -> Floats:
    """Return values (candidates, samples) less their projection onto columns, 0 if weightless."""
    answer = _least_squares(columns, values, weight)
    left: Floats = (values - np.einsum('cnk,ck->cn', columns, answer)) * weight
    return left
