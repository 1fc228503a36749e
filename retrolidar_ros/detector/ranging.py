# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Range of a marker, without the background that merges with it.

A target too near to the marker to be separated merges with it, and the distance reported is the
mean of both, weighted by signal. So signal times distance is a sum, of which the marker's part is
modulated and the background's is not: the modulation of signal times distance over that of the
signal is the distance of the marker alone.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.sensor.frame import MOST_DISTANCE_M, SEPARABLE_M, Floats, ZoneGrid

# Samples with more light than the first show the marker; with less than the second, the background.
BRIGHT, _DARK = 0.75, 0.25
_LEAST_DISTANCES = 2
# A zone sees the marker while its signal has this share of that at this quantile.
_IN_ZONE, _BRIGHTEST = 0.5, 0.9
# So near to the limit noise may hide whether two targets are merged.
_UNSURE_M = 0.05
# Distance of a marker from the surface that it is mounted on.
_MOUNTING_M = 0.005
# Quantisation noise of the sensor, the least that there can be.
_RESOLUTION_M = 0.25e-3 / np.sqrt(12)


class Ranged(NamedTuple):
    """Range of a marker in one zone."""

    range_m: float
    """Radial distance."""
    stddev_m: float
    time_s: float
    """When the range holds: the mean time of the samples used."""


def modulated_range(
    time_s: Floats,
    light: Floats,
    weight: Floats,
    signal: Floats,
    distance: Floats,
    zone: int,
    grid: ZoneGrid,
) -> Ranged | None:
    """Return the range of a marker; None without distances.

    Parameters
    ----------
    time_s : array, shape (samples,)
        Middle of each exposure [s].
    light : array, shape (samples,)
        Light of the marker, 0 to 1.
    weight : array, shape (samples,)
        0 for samples that are not valid.
    signal : array, shape (samples,)
        [kcps/SPAD]; 0 where there was no target.
    distance : array, shape (samples,)
        As reported, along the optical axis [m]; NaN where there was no target.
    zone : int
        The zone of these samples.
    grid : ZoneGrid
        The zones.
    """
    measured = np.isfinite(distance)
    seen = measured & (weight > 0) & (light > BRIGHT)
    if not seen.any():
        return None
    # A moving marker is in the zone for a part of the time only.
    seen &= signal > _IN_ZONE * _quantile(signal[seen], _BRIGHTEST)
    if not seen.any():
        return None
    ordered = np.sort(distance[seen])
    about = float(ordered[len(ordered) // 2])
    own = seen.copy()
    own[seen] = np.abs(distance[seen] - about) < SEPARABLE_M
    count = np.count_nonzero(own)
    if count < _LEAST_DISTANCES:
        return None
    depth = float(distance[own].mean())
    variance = float(distance[own].var(ddof=1)) / count
    dark = (weight > 0) & (light < _DARK)
    parted = _without_background(light, signal, distance, own | dark, depth)
    behind = distance[dark & measured]
    if parted is not None and dark.any() and not _is_apart(behind, depth, *parted):
        share = signal[dark].mean() / max(float(signal[own].mean()), 1e-9)
        depth, variance = _weighed(depth, variance, *parted, max(float(share), 1e-3))
    if not 0 < depth < MOST_DISTANCE_M:  # by noise, or by samples that no sensor measures
        return None
    # Undo the sensor's own projection, whose factor is that of the zone and not of the target.
    per_depth = 1 / float(grid.z_per_range[zone])
    deviation = np.sqrt(variance + _RESOLUTION_M**2 / count)
    return Ranged(depth * per_depth, float(deviation) * per_depth, float(time_s[own].mean()))


def _quantile(values: Floats, share: float) -> float:
    """Return the value that a share of the values are below, as `numpy.quantile`, but faster."""
    ordered = np.sort(values)
    place = share * (len(ordered) - 1)
    before = int(place)
    low, high = ordered[before], ordered[min(before + 1, len(ordered) - 1)]
    return float(low + (place - before) * (high - low))


def _is_apart(behind: Floats, depth: float, parted_m: float, parted_variance: float) -> bool:
    """Return whether the background is separated from the marker, so no part of its pulse.

    Near the limit it is if subtracting it would put the marker beyond the limit.

    Parameters
    ----------
    behind : array
        Distances while the marker was dark [m].
    depth : float
        Mean distance while it was bright [m].
    parted_m, parted_variance : float
        Distance of the marker if the two have merged [m], and its variance [m²].
    """
    if not len(behind):
        return False
    wall_m = _quantile(behind, 0.5)
    gap_m = abs(wall_m - depth)
    if gap_m < SEPARABLE_M - _UNSURE_M:
        return False
    beyond = abs(wall_m - parted_m) - 3 * math.sqrt(parted_variance) > SEPARABLE_M
    return gap_m >= SEPARABLE_M or beyond


def _weighed(
    plain_m: float, plain_variance: float, parted_m: float, parted_variance: float, share: float
) -> tuple[float, float]:
    """Return a distance and its variance, with and without the background weighted.

    The background in the same pulse is mostly what the marker is mounted on, at its own distance,
    and then subtracting it only adds noise. So two hypotheses are weighted by the step between the
    two distances: that it is noise and mounting, or that a background is anywhere.

    Parameters
    ----------
    plain_m, plain_variance : float
        Mean of the bright samples [m], and its variance.
    parted_m, parted_variance : float
        The same without the background.
    share : float
        Of the background in the signal while the marker is bright.
    """
    step = parted_m - plain_m
    noise = max(parted_variance - plain_variance, 0.0)
    mounting = (_MOUNTING_M * share) ** 2
    spread = noise + mounting
    mounted = math.exp(-step * step / (2 * spread)) / math.sqrt(2 * math.pi * spread)
    free = 1 / (2 * SEPARABLE_M * share)
    chance = free / (mounted + free)
    near_m = plain_m + step * mounting / spread
    near_variance = plain_variance + noise * mounting / spread
    apart_m = parted_m - near_m
    variance = (1 - chance) * near_variance + chance * parted_variance
    return near_m + chance * apart_m, variance + chance * (1 - chance) * apart_m**2


def _without_background(
    light: Floats, signal: Floats, distance: Floats, used: NDArray[np.bool_], about: float
) -> tuple[float, float] | None:
    """Return the distance of the modulated part [m] and its variance [m²]; None without one.

    Parameters
    ----------
    light, signal, distance : array, shape (samples,)
    used : array of bool, shape (samples,)
        The samples to be used.
    about : float
        A first guess [m].
    """
    light, signal, distance = light[used], signal[used], distance[used]
    change = light - light.mean()
    energy = change @ change
    if not energy > 0 or not (gain := change @ signal / energy) > 0:
        return None
    # Distances are relative to a guess, so that noise of the signal has no lever; the second time
    # the guess is good, and the residual gives the variance.
    for _ in range(2):
        product = np.where(np.isfinite(distance), signal * (distance - about), 0.0)
        slope = change @ product / energy
        about += float(slope / gain)
    left = product - product.mean() - slope * change
    variance = left @ left / max(len(left) - 2, 1) / energy / gain**2
    return about, float(variance)
