# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a scene may name. What it does not name is not there, and is not computed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.marker.known_markers import MARKER_SIZE_M
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.sensor.frame import ZoneGrid

__all__ = [
    'Marker',
    'MovingSurface',
    'Noise',
    'Occlusion',
    'Ranging',
    'Response',
    'Scene',
    'SecondSensor',
    'Sensor',
    'Surface',
    'Wander',
    'Waypoint',
]

NEAREST_M = 1e-3
SIGNAL_AT_1_M = 360.0
"""Of 9 cm² facing the sensor [kcps/SPAD], from paper §3.2 and §4: a bare retroreflector of that
size returns 100.4 times what a board does, which is 4 kcps/SPAD at 1.4 m; the crystal's polarisers
let a quarter of it pass."""


@dataclass(frozen=True)
class Noise:
    """Frame-to-frame variance of the signal: floor + slope · signal + ambient · ambient light."""

    floor: float
    """[(kcps/SPAD)²]"""
    slope: float
    """[kcps/SPAD]"""
    ambient: float = 0.0
    """[kcps/SPAD]"""


@dataclass(frozen=True)
class Ranging:
    """Standard deviation of the distance: hypot(shot / signal, floor)."""

    shot: float
    """Deviation at a signal of one kcps/SPAD [m]."""
    floor: float
    """[m]"""
    offset: float = 0.0
    """By how much all ranges are too long [m]."""


@dataclass(frozen=True)
class SecondSensor:
    """Another sensor, not in step with this one, whose light is part of what this one sees."""

    ambient: float
    """By how much it raises the ambient light while it sends [kcps/SPAD]."""
    period_s: float
    lasting_s: float
    """How long it sends in each of its periods."""


@dataclass(frozen=True)
class Waypoint:
    """Where something is at a time; between two of them it moves evenly.

    After the last one the path restarts.
    """

    time_s: float
    position_m: tuple[float, float, float]
    yaw_rad: float = 0.0
    """To the right."""
    pitch_rad: float = 0.0
    """Upwards."""


@dataclass(frozen=True)
class Sensor:
    """The LiDAR and its clock."""

    grid: ZoneGrid = ZoneGrid()
    period_s: float = 0.021
    period_error: float = 0.0
    """Relative error of the frame period."""
    clock_error: float = 0.0
    """Relative error of the clock that stamps the frames."""
    jitter_s: float = 0.0
    """Standard deviation of the time of a frame, before it is limited to twice that."""
    blur: float = 0.0
    """Standard deviation of the optical blur, as a share of a zone's width."""
    noise: Noise | None = None
    ranging: Ranging | None = None
    target_threshold: float = 0.0
    """Signal below which the sensor reports no target [kcps/SPAD]; 0 = the last digit suffices."""
    lost: float = 0.0
    """Share of frames that never arrive."""
    abnormal: float = 0.0
    """Share of samples with an abnormal status and meaningless values."""
    saturation: float = math.inf
    """The most that a SPAD can count, one over its dead time [kcps/SPAD]."""
    crosstalk: float = 0.0
    """Signal that a cover glass throws back, a target of its own at the sensor [kcps/SPAD]."""
    second_sensor: SecondSensor | None = None
    path: tuple[Waypoint, ...] = ()
    """Poses in the frame of the scene; none = at its origin."""


@dataclass(frozen=True)
class Wander:
    """A smooth motion about the marker's position: slow sines of unlike periods."""

    across_m: float
    """Amplitude along x and along y."""
    along_m: float
    """Amplitude along z."""
    period_s: float


@dataclass(frozen=True)
class Occlusion:
    """Something that hides the marker again and again."""

    every_s: float
    lasting_s: float


@dataclass(frozen=True)
class Marker:
    """A liquid-crystal marker."""

    id: int
    position_m: tuple[float, float, float]
    """In the optical frame: x right, y down, z forward."""
    name: str
    size_m: float = MARKER_SIZE_M
    """Edge of the square retroreflector."""
    yaw_rad: float = 0.0
    bit_period_s: float = BIT_PERIOD_S
    clock_error: float = 0.0
    """Relative error of the bit period."""
    start_s: float = 0.0
    """When its first packet begins; it is bright before."""
    packets: int | None = None
    """How many packets it sends; None = without end."""
    gap_bits: int = 0
    signal_at_1_m: float = SIGNAL_AT_1_M
    """Of a bright 3 cm one facing the sensor [kcps/SPAD]."""
    contrast: float = 1.0
    """Share of its light that a dark crystal blocks."""
    response: Response | None = None
    wander: Wander | None = None
    occlusion: Occlusion | None = None


@dataclass(frozen=True)
class Surface:
    """A background at one distance along the optical axis."""

    distance_m: float
    signal: float
    """[kcps/SPAD]"""
    zones: tuple[int, ...] | None = None
    """Where it is seen; None = in every zone."""


@dataclass(frozen=True)
class MovingSurface:
    """A dull square facing the sensor, such as a hand, on a path; it hides what is behind it."""

    width_m: float
    signal: float
    """Of a zone that it fills at 1 m [kcps/SPAD]."""
    path: tuple[Waypoint, ...]


@dataclass(frozen=True)
class Scene:
    """Everything that a simulation computes."""

    description: str = ''
    seed: int = 0
    duration_s: float = 30.0
    sensor: Sensor = Sensor()
    markers: tuple[Marker, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    moving_surfaces: tuple[MovingSurface, ...] = ()
    ambient: float = 0.0
    """[kcps/SPAD]"""
