# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bearing of a marker within a zone, from how its light is shared between zones.

Only light that is modulated as the marker's counts, so the background cancels. A marker's spot is
mostly smaller than a zone, and then the shares say much near edges of zones and little in their
middle. So the result is the mean and the variance of all bearings that agree with the shares: a
marker that one zone sees alone is anywhere in it, except near edges where a neighbour would see it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from retrolidar_ros.sensor.frame import Floats, ZoneGrid

# Possible blur of a spot, as standard deviations in widths of a zone: it differs with the lens and
# the sharpener's setting, and a moving marker blurs its own spot.
_BLURS = np.array([0.03, 0.05, 0.08, 0.12, 0.18, 0.25, 0.35])
# A blur that is known is so to this share of it; besides, a marker on the move has a chance.
_BLUR_DOUBT, _SMEARED = 0.3, 1e-3
# Bearings tried across the strongest zone and a bit beyond, in widths of a zone; denser near its
# edges, where the shares of two zones tell them apart.
_PLACES = np.concatenate(
    [
        np.linspace(-0.7, -0.6, 5, endpoint=False),
        np.linspace(-0.6, -0.4, 50, endpoint=False),
        np.linspace(-0.4, 0.4, 40, endpoint=False),
        np.linspace(0.4, 0.6, 50, endpoint=False),
        np.linspace(0.6, 0.7, 6),
    ]
)
_PRIOR = np.gradient(_PLACES)
# Share of the light by which a zone may deviate from the model.
_MODEL_ERROR = 0.02

_LEAST_DOUBT = 1e-6  # [kcps/SPAD]
# The integral of the cumulative normal distribution, less that of the unit step.
_MOST_SCORE, _STEPS_A_SCORE = 5, 100
_SCORES = np.linspace(-_MOST_SCORE, _MOST_SCORE, 2 * _MOST_SCORE * _STEPS_A_SCORE + 1)
_RAMP_EXCESS = np.array(
    [
        math.exp(-score * score / 2) / math.sqrt(2 * math.pi)
        - abs(score) * math.erfc(abs(score) / math.sqrt(2)) / 2
        for score in _SCORES.tolist()
    ]
)
_RAMP_STEPS = np.append(np.diff(_RAMP_EXCESS), 0.0)
# The edges of three zones in a row, from the middle one's centre, seen from each place.
_EDGES = np.array([-1.5, -0.5, 0.5, 1.5]) - _PLACES[:, None]


class Bearing(NamedTuple):
    """A direction as tangents to the optical axis, x/z and y/z."""

    tangent: Floats
    """Shape (2,)."""
    variance: Floats
    """Of each tangent, shape (2,)."""


def zone_bearing(zone: int, grid: ZoneGrid) -> Bearing:
    """Return the bearing of a marker that may be anywhere in a zone."""
    return Bearing(grid.tangents[zone], np.full(2, grid.pitch**2 / 12))


def shared_bearing(
    zone: int,
    amplitude: Floats,
    variance: Floats,
    spot: float,
    grid: ZoneGrid,
    known_blur: float | None = None,
) -> Bearing:
    """Return the bearing of a marker from its share in every zone.

    Parameters
    ----------
    zone : int
        The one with the largest amplitude.
    amplitude, variance : array, shape (zones,)
        Modulation of each zone by the marker [kcps/SPAD], and its variance [(kcps/SPAD)²].
    spot : float
        Width of the marker, as a tangent.
    grid : ZoneGrid
        The zones.
    known_blur : float, optional
        How far the optics blur, in widths of a zone.
    """
    row, column = divmod(zone, grid.columns)
    rows = slice(max(row - 1, 0), min(row + 2, grid.rows))
    columns = slice(max(column - 1, 0), min(column + 2, grid.columns))
    shape = (grid.rows, grid.columns)
    light = amplitude.reshape(shape)
    doubt = variance.reshape(shape) + max(_MODEL_ERROR * float(amplitude[zone]), _LEAST_DOUBT) ** 2
    shares = _shares(spot / grid.pitch)
    # Neighbours across and down suffice: the shares of others are products of theirs.
    across, across_belief = _belief(
        light[row, columns], doubt[row, columns], _from_middle(shares, columns, column)
    )
    down, down_belief = _belief(
        light[rows, column], doubt[rows, column], _from_middle(shares, rows, row)
    )
    # The less blur, the less room for a bearing between zones: without this, a marker that is
    # there would be proof of a large one.
    prior = _BLURS**-0.5
    if known_blur is not None:
        prior = np.exp(-((np.log(_BLURS / known_blur) / _BLUR_DOUBT) ** 2) / 2) + _SMEARED
    blur = across_belief * down_belief * prior
    blur /= blur.sum()
    mean = np.empty(2)
    spread = np.empty(2)
    for axis, belief in enumerate((across, down)):
        chance = blur @ belief
        mean[axis] = chance @ _PLACES
        spread[axis] = chance @ (_PLACES - mean[axis]) ** 2
    return Bearing(grid.tangents[zone] + grid.pitch * mean, grid.pitch**2 * spread)


def _shares(width: float) -> Floats:
    """Return the share of a marker in each of three zones in a row, at places around the middle.

    Parameters
    ----------
    width : float
        Of the marker, in widths of a zone.

    Returns
    -------
    share : array, shape (blurs, places, 3)
        Of its light.
    """
    distance = np.stack([_EDGES + width / 2, _EDGES - width / 2])
    upper, lower = _ramp(distance).swapaxes(0, 1)
    share: Floats = np.diff((upper - lower) / width, axis=-1)
    return share


def _from_middle(shares: Floats, steps: slice, centre: int) -> Floats:
    """Return the shares of the rows or columns around the central one that exist in the grid."""
    return shares[..., steps.start - centre + 1 : steps.stop - centre + 1]


def _belief(light: Floats, doubt: Floats, share: Floats) -> tuple[Floats, Floats]:
    """Return the likelihood of each place along one axis, given each blur, and of each blur.

    Parameters
    ----------
    light, doubt : array, shape (n,)
        Light in neighbouring rows or columns, and its variance.
    share : array, shape (blurs, places, n)
        Share of a marker in each of them.

    Returns
    -------
    belief : array, shape (blurs, places)
        Each row sums to 1.
    likelihood : array, shape (blurs,)
        Up to a factor.
    """
    # The strength that fits best is taken for each place: shape (blurs, places).
    common = share @ (light / doubt)
    energy = (share * share) @ (1 / doubt)
    fitness = np.maximum(common, 0.0) ** 2 / np.maximum(energy, 1e-30) / 2
    likelihood = _PRIOR * np.exp(fitness - fitness.max())
    total = likelihood.sum(axis=1)
    belief: Floats = likelihood / np.maximum(total, 1e-300)[:, None]
    return belief, total


def _ramp(distance: Floats) -> Floats:
    """Integrate the blurred unit step up to distances (...): shape (blurs, ...)."""
    blurs = _BLURS.reshape(-1, *[1] * distance.ndim)
    # The excess is interpolated; its scores are equal steps, so nothing need be searched.
    step = np.clip((distance / blurs + _MOST_SCORE) * _STEPS_A_SCORE, 0, len(_SCORES) - 1)
    before = step.astype(np.intp)
    excess = _RAMP_EXCESS[before] + (step - before) * _RAMP_STEPS[before]
    ramp: Floats = np.maximum(distance, 0.0) + blurs * excess
    return ramp
