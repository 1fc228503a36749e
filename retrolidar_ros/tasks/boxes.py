# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Directions uniform within boxes, approximated by Gaussians (Minka 2001).

A marker that a single zone sees may be anywhere in the zone, however often it is read there. So
each box is replaced by the Gaussian that gives the state, with all other readings, the same mean
and variance: expectation propagation.
"""

from __future__ import annotations

import math

import numpy as np

from retrolidar_ros.scene.optics import erf
from retrolidar_ros.sensor.frame import Floats

# Probability density of an outlier, for each radian of half a box.
_ASTRAY = 0.02


def same_boxes(jacobian: Floats, spread: Floats, mean: Floats, half: Floats) -> Floats:
    """Return how many boxes are redundant with each, itself included, shape (n, 2).

    Two are if their directions are correlated and at the same place of their boxes: together
    they tell no more than one.
    """
    rows = jacobian.reshape(-1, jacobian.shape[-1])
    together = rows @ spread @ rows.T
    deviation = np.sqrt(np.diag(together))
    place, size = mean.ravel(), half.ravel()
    apart = np.abs(place[:, None] - place) / np.minimum.outer(size, size)
    same = (together / np.outer(deviation, deviation)) ** 2 * np.maximum(1 - 2 * apart, 0.0)
    count: Floats = same.sum(axis=1).reshape(mean.shape)
    return count


def match_boxes(
    mean: Floats, variance: Floats, precision: Floats, middle: Floats, half: Floats, soft: Floats
) -> tuple[Floats, Floats]:
    """Return weights and means of the Gaussians that replace boxes, given all the others.

    Parameters
    ----------
    mean, variance : array, shape (n, 2)
        Of the directions, as the state has them now.
    precision, middle : array, shape (n, 2)
        Of the Gaussians that replaced the boxes so far.
    half, soft : array, shape (n, 2)
        Half the widths of the boxes, and the variance of their edges.
    """
    left = np.maximum(1 / variance - precision, 0.1 / variance)
    mean = (mean / variance - precision * middle) / left
    total = 1 / left + soft
    deviation = np.sqrt(total)
    low, high = (-half - mean) / deviation, (half - mean) / deviation
    inside = (erf(high / math.sqrt(2)) - erf(low / math.sqrt(2))) / 2
    low_density, high_density = (np.exp(-0.5 * x * x) / math.sqrt(2 * math.pi) for x in (low, high))
    chance = inside + _ASTRAY * half
    slope = (low_density - high_density) / deviation / chance
    bend = slope**2 + (high * high_density - low * low_density) / total / chance
    bend = np.clip(bend, 1e-9, 0.999 * left)
    return bend / (1 - bend / left), mean + slope / bend
