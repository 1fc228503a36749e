# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Where a sensor has to go for landmarks to be known best."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.landmarks import Landmark

_WAYS = np.array([way for way in itertools.product((-1, 0, 1), repeat=3) if any(way)], dtype=float)
_NEAREST_M = 0.3


def best_place(landmarks: Sequence[Landmark], middle_m: Floats, reach_m: float) -> Floats | None:
    """Return the place from which one more reading of each landmark says most about all.

    It is the one that leaves the least mean squared error. Across the line of sight ranges from
    there tell the direction; nearer, they are more exact, too.

    Parameters
    ----------
    landmarks : sequence of Landmark
        Those that are not known well enough yet.
    middle_m : array, shape (3,)
        In the fixed frame.
    reach_m : float
        How far from there the sensor can go in any direction.

    Returns
    -------
    array, shape (3,), or None
        In the fixed frame [m]; None if none of them has been read.
    """
    seen = [one for one in landmarks if one.fit is not None and one.members]
    places = middle_m + reach_m * _WAYS / np.linalg.norm(_WAYS, axis=1)[:, None]
    errors = np.array([sum(_error_after(one, place_m) for one in seen) for place_m in places])
    return places[int(errors.argmin())] if seen and np.isfinite(errors.min()) else None


def _error_after(landmark: Landmark, place_m: Floats) -> float:
    """Return the mean squared error with one more reading [m²]; infinite if it is too near."""
    assert landmark.fit is not None
    last = max(landmark.members, key=lambda one: one.stamp_s)
    range_m = float(np.linalg.norm(landmark.fit.state.position_m - place_m))
    if range_m < _NEAREST_M:
        return np.inf
    # The noise of a range rises with about its square.
    view = last._replace(
        pose=last.pose._replace(position_m=place_m),
        range_m=range_m,
        range_stddev_m=last.range_stddev_m * (range_m / last.range_m) ** 2,
    )
    return float(np.trace(landmark.spread_with([view])))
