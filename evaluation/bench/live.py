# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings as a robot has them, frame by frame: when each is known, and how wrong it is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from evaluation.bench.rates import Rate, rate
from retrolidar_ros.detector import Detection, Detector
from retrolidar_ros.detector.place import Place
from retrolidar_ros.sensor.frame import Floats, Recording

ELLIPSOID = 7.815
"""95 % of a normal distribution in three dimensions are within so many squared deviations."""


class LiveReading(NamedTuple):
    """A detection, and when it is known."""

    known_ns: int  # stamp of the frame with which it came [ns]
    detection: Detection


class PlaceError(NamedTuple):
    """By how much a place is wrong."""

    range_m: float  # measured less true
    position_m: float  # distance between measured and true position
    bearing_deg: float  # angle between measured and true direction
    squared_distance: float  # of the position, in standard deviations of its covariance


def read_live(detector: Detector, recording: Recording) -> Iterator[LiveReading]:
    """Give frames to a detector one by one, and yield what comes of each."""
    for frame in recording:
        for detection in detector.update(frame):
            yield LiveReading(frame.stamp_ns, detection)


def place_error(place: Place, truth_m: Floats) -> PlaceError:
    """Return by how much a place differs from where the marker was at its stamp, shape (3,) [m]."""
    range_m = float(np.linalg.norm(truth_m))
    offset = place.position_m - truth_m
    across = float(np.linalg.norm(np.cross(place.position_m, truth_m)))
    return PlaceError(
        range_m=place.range_m - range_m,
        position_m=float(np.linalg.norm(offset)),
        bearing_deg=float(np.degrees(np.arctan2(across, place.position_m @ truth_m))),
        squared_distance=float(offset @ np.linalg.solve(place.covariance[:3, :3], offset)),
    )


def millimetres(lengths_m: ArrayLike) -> list[float]:
    """Return lengths [m] in millimetres, to a hundredth."""
    rounded: list[float] = np.round(1e3 * np.asarray(lengths_m), 2).tolist()
    return rounded


def held(squared_distances: ArrayLike) -> Rate | None:
    """Return in how many places the truth is within the 95 % ellipsoid; None without any."""
    squared = np.asarray(squared_distances)
    return rate(int(np.count_nonzero(squared <= ELLIPSOID)), squared.size) if squared.size else None
