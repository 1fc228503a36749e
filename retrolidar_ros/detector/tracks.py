# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks: the place of every marker that was read, at every frame, as the core follows it."""

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from retrolidar_ros.core import lib
from retrolidar_ros.detector.detection import Bearing, Place, place
from retrolidar_ros.sensor.frame import Floats

MAX_TRACKS = int(lib.RL_MAX_TRACKS)
_ACROSS_M_S = 0.5  # deviation of a velocity across the line of sight, which is not measured
_ACROSS = _ACROSS_M_S**2 * np.eye(3)


@dataclass(frozen=True, eq=False)
class Track:
    """One marker that is followed, at one frame; the fields mirror `MarkerTrack.msg`."""

    id: int
    stamp_ns: int  # of the frame [ns]
    place: Place
    velocity: Floats  # in the optical frame, shape (3,) [m/s]; measured along the range only
    velocity_covariance: Floats  # shape (3, 3) [m²/s²]
    presence: float  # log odds that the marker is still there, and still this one [nats]
    first_ns: int  # when its first packet began [ns]
    last_ns: int  # time of the newest frame in which its light was seen [ns]


class TrackCounts(NamedTuple):
    """Tracks so far."""

    started: int
    ended: int
    dropped: int  # tracks that were dropped because there were more than `MAX_TRACKS`


def track_of(seen: Any, stamp_ns: int, origin_ns: int) -> Track:
    """Return a track of the core, whose times are since an origin."""
    bearing = Bearing(np.array([*seen.tangent]), np.array([*seen.tangent_variance]))
    where = place(bearing, seen.range_m, math.sqrt(seen.range_variance))
    direction = where.position_m / seen.range_m
    along = direction[:, None] * direction
    return Track(
        id=seen.id,
        stamp_ns=stamp_ns,
        place=where,
        velocity=seen.range_rate * direction,
        velocity_covariance=(seen.range_rate_variance - _ACROSS_M_S**2) * along + _ACROSS,
        presence=seen.log_odds,
        first_ns=origin_ns + round(seen.first_s * 1e9),
        last_ns=seen.last_ns,
    )
