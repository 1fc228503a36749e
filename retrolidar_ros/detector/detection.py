# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The results of a detector: detections and tracks of markers, with their poses, and counts."""

import math
from collections import Counter
from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

import numpy as np

from retrolidar_ros.core import ffi, lib
from retrolidar_ros.sensor.frame import Floats, ZoneGrid

MAX_TRACKS = int(lib.RL_MAX_TRACKS)


class Bearing(NamedTuple):
    """A direction as tangents to the optical axis, x/z and y/z."""

    tangent: Floats  # shape (2,)
    variance: Floats  # of each tangent, shape (2,)


def zone_bearing(zone: int, grid: ZoneGrid) -> Bearing:
    """Return the bearing of a marker that may be anywhere in a zone."""
    return Bearing(grid.tangents[zone], np.full(2, grid.pitch**2 / 12))


@dataclass(frozen=True, eq=False)
class Place:
    """A marker's pose in the optical frame of the sensor: x right, y down, z forward."""

    position_m: Floats  # shape (3,)
    orientation: Floats  # quaternion (x, y, z, w): facing the sensor, z pointing away from it
    covariance: Floats  # of x, y, z [m²] and rotations about these axes [rad²], shape (6, 6)
    range_m: float  # radial distance
    range_stddev_m: float


def place(bearing: Bearing, range_m: float, range_stddev_m: float) -> Place:
    """Return the pose of a marker, with the variance of what is not measured; ranges in [m]."""
    variance = bearing.variance.tolist()
    pose = ffi.new('struct rl_pose *')
    lib.rl_pose(bearing.tangent.tolist(), variance, range_m, range_stddev_m**2, pose)
    values = np.frombuffer(ffi.buffer(pose))
    return Place(
        position_m=values[:3],
        orientation=values[3:7],
        covariance=values[7:].reshape(6, 6),
        range_m=range_m,
        range_stddev_m=range_stddev_m,
    )


def largest_stddev(covariance: Floats) -> float:
    """Return the largest deviation along any axis of a covariance; infinite if it is no number."""
    if not np.isfinite(covariance).all():
        return math.inf
    return math.sqrt(max(float(np.linalg.eigvalsh(covariance)[-1]), 0.0))


@dataclass(frozen=True, eq=False)
class Detection:
    """One marker, read once; the fields mirror `MarkerDetection.msg`."""

    id: int
    stamp_ns: int  # when the place holds: the mean time of the samples used for it [ns]
    start_ns: int  # when the (first) packet, most of which was used, began [ns]
    end_ns: int  # time of the last frame used [ns]
    place: Place
    snr_db: float  # 20 log10 of amplitude over a sample's deviation from the fitted packet [dB]
    evidence: float  # log likelihood ratio against no packet [nats]; NaN where a method has none
    decision_margin: float  # the same against the nearest other ID [nats]; NaN likewise
    bit_period_s: float  # how long the marker holds a bit, as measured [s]
    score: float  # normalised correlation of the samples with the sent packet, 0 to 1
    likelihood: float  # the paper's l at the start of the packet
    corrected_bits: int
    packets: int
    zones: tuple[int, ...]  # indices of the zones used, strongest first


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


@dataclass
class DetectorCounts:
    """Candidates by outcome so far, and tracks."""

    candidates: int = 0  # packets found, one for every zone that saw one
    accepted: int = 0
    rejected: Counter[str] = field(default_factory=Counter)  # by reason
    impossible: int = 0  # samples with a valid status but an impossible signal or distance
    overloads: int = 0  # frames with too many candidates, of which the least likely were dropped
    tracks_ended: int = 0
    tracks_dropped: int = 0  # because there were more than `MAX_TRACKS`


class Thresholds(NamedTuple):
    """Thresholds of log likelihood ratios [nats]."""

    evidence: float  # minimum ratio to noise and a wandering level
    wandering: float  # added to it where the level wanders
    word: float  # maximum log likelihood ratio of another bit sequence
    margin: float  # minimum ratio to any other ID
    margin_of_more: float  # the same if more packets may follow: then an ambiguous one can wait


class Reason(str, Enum):
    """Why a candidate is rejected, as diagnostics and tables name it."""

    EVIDENCE = 'evidence'  # noise, a wandering level and packets read before do as well
    NOT_A_WORD = 'not a word'  # other bits, of no packet or of another clock, do much better
    MARGIN = 'margin'  # a packet of another ID does nearly as well
    INCOMPLETE = 'incomplete'  # the packet may not have ended, or not repeat, or its clock is off
    ERASED = 'erased'  # too few of its samples are valid
    DISTANCE = 'distance'  # it was read, but no distance was measured


class Candidate(NamedTuple):
    """A packet that was judged."""

    id: int
    zone: int  # the zone, or from `zones` on the sum of zones, that was searched
    packets: int
    reason: Reason | None  # why it was rejected; None if it was read
    start_ns: int
    bit_period_s: float
    evidence: float  # [nats]; like the next two 0 if it was rejected before
    word: float  # log likelihood of the best other sequence of bits less its own [nats]
    margin: float  # [nats]


def check_grid(grid: ZoneGrid, expected: ZoneGrid) -> None:
    """Raise ValueError if a frame has another zone grid than the detector that it came to."""
    if grid is not expected and grid != expected:
        raise ValueError(
            f'a frame of {grid.rows}x{grid.columns} zones came to a detector '
            f'for {expected.rows}x{expected.columns}'
        )
