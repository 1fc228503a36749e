# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Readings as a sensor would give them, and what is asserted of estimates."""

import itertools

import numpy as np

from retrolidar_ros.sensor.frame import Floats, ZoneGrid
from retrolidar_ros.tasks.landmarks import Estimate, Landmark
from retrolidar_ros.tasks.reading import Errors, KnownPose, Reading, SensorPose, reading

GRID = ZoneGrid()
NOISE_M = 0.001
ERRORS = Errors(range_bias_m=1e-4, pose_m=1e-4, turn_rad=1e-4)
ALONE = {7: np.zeros(3)}
SQUARE = [np.array([x, y, 0.0]) for x, y in ((-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2))]
FORWARD = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
"""How a sensor that looks forward is turned in a base with x forward and z up (REP 103)."""
HERE = np.array([0.1, -0.05, 1.2])


def seen(
    place_m: Floats,
    eye_m: Floats,
    rng: np.random.Generator,
    *,
    marker: int = 7,
    stamp_s: float = 0.0,
    sensor: str = 'hand',
    rotation: Floats | None = None,
) -> Reading:
    """A zone sees a marker: its range is exact to a millimetre, its direction the zone's middle."""
    turn = np.eye(3) if rotation is None else rotation
    own = (place_m - eye_m) @ turn
    zone = np.rint(own[:2] / own[2] / GRID.pitch - 0.5) + 0.5
    middle = np.append(zone * GRID.pitch, 1.0)
    range_m = float(np.linalg.norm(own))
    middle *= range_m / np.linalg.norm(middle)
    across = (GRID.pitch * range_m) ** 2 / 12
    return reading(
        marker,
        sensor,
        stamp_s,
        range_m + float(rng.normal(0, NOISE_M)),
        NOISE_M,
        middle,
        np.diag([across, across, 1e-6]),
        SensorPose(eye_m, turn),
    )


def look_round(landmark: Landmark, place_m: Floats, rng: np.random.Generator) -> None:
    for index, (eye_m, _) in enumerate(itertools.product(SQUARE, range(3))):
        landmark.take(seen(place_m, eye_m, rng, stamp_s=index))


def estimate_of(landmark: Landmark) -> Estimate:
    estimate = landmark.estimate()
    assert estimate is not None
    return estimate


def prior_at(place_m: Floats, variance: float, turn_variance: float) -> KnownPose:
    """Return what is known before of something that is not turned [m^2, rad^2]."""
    covariance = np.diag([variance] * 3 + [turn_variance] * 3)
    return KnownPose(place_m, np.eye(3), covariance)


def mapped(name: str, place_m: Floats) -> Estimate:
    """Return a landmark as a map holds it."""
    return estimate_of(Landmark(name, {}, Errors(), prior_at(place_m, 1e-6, 1e-6)))


def squared(estimate: Estimate | KnownPose, truth_m: Floats) -> float:
    """Return the squared distance from the truth, in deviations."""
    off = estimate.position_m - truth_m
    return float(off @ np.linalg.solve(estimate.covariance[:3, :3], off))
