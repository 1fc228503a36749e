# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a scene may name. What it does not name is not there, and is not computed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS
from retrolidar_ros.marker.known_markers import MARKER_SIZE_M
from retrolidar_ros.marker.liquid_crystal import Response
from retrolidar_ros.sensor.frame import ZONE_SHAPES, ZoneGrid
from retrolidar_ros.settings.section import ConfigError, Section, integer, items, quantity, text

__all__ = [
    'Marker',
    'Noise',
    'Occlusion',
    'Ranging',
    'Response',
    'Scene',
    'Sensor',
    'Surface',
    'Wander',
    'parse_scene',
]

_NEAREST_M = 1e-3


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
class Scene:
    """Everything that a simulation computes."""

    description: str = ''
    seed: int = 0
    duration_s: float = 30.0
    sensor: Sensor = Sensor()
    markers: tuple[Marker, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    ambient: float = 0.0
    """[kcps/SPAD]"""


def _grid(value: Any, path: str) -> ZoneGrid:
    shapes = {f'{rows}x{columns}': ZoneGrid(rows, columns) for rows, columns in ZONE_SHAPES}
    if not isinstance(value, str) or value not in shapes:
        raise ConfigError(f'{path}: {value!r} is not {" or ".join(shapes)}')
    return shapes[value]


def _noise(value: Any, path: str) -> Noise:
    section = Section(value, path)
    noise = Noise(
        floor=section.need('floor', quantity('variance', 0)),
        slope=section.need('slope', quantity('signal', 0)),
        ambient=section.take('ambient', 0.0, quantity('signal', 0)),
    )
    section.end()
    return noise


def _ranging(value: Any, path: str) -> Ranging:
    section = Section(value, path)
    ranging = Ranging(
        shot=section.need('shot', quantity('length', 0)),
        floor=section.need('floor', quantity('length', 0)),
    )
    section.end()
    return ranging


def _sensor(value: Any, path: str) -> Sensor:
    section = Section(value, path)
    share = quantity('share', 0, 1)
    error = quantity('share', -0.05, 0.05)
    sensor = Sensor(
        grid=section.take('zones', Sensor.grid, _grid),
        period_s=section.take('period', Sensor.period_s, quantity('time', 1e-3, 10)),
        period_error=section.take('period_error', 0.0, error),
        clock_error=section.take('clock_error', 0.0, error),
        jitter_s=section.take('jitter', 0.0, quantity('time', 0, 5e-3)),
        blur=section.take('blur', 0.0, share),
        noise=section.take('noise', None, _noise),
        ranging=section.take('ranging', None, _ranging),
        target_threshold=section.take('target_threshold', 0.0, quantity('signal', 0)),
        lost=section.take('lost', 0.0, quantity('share', 0, 0.99)),
        abnormal=section.take('abnormal', 0.0, share),
    )
    section.end()
    if sensor.jitter_s * 4 >= sensor.period_s * (1 + sensor.period_error):
        raise ConfigError(f'{path}.jitter: frames would overtake each other; less than period / 4')
    return sensor


def _position(value: Any, path: str) -> tuple[float, float, float]:
    parts = items(value, path)
    if len(parts) != 3:
        raise ConfigError(f'{path}: needs x, y and z, not {len(parts)} values')
    x, y, z = (quantity('length')(*part) for part in parts)
    if z < _NEAREST_M:
        raise ConfigError(f'{path}: z of {z:g} m is impossible; at least {_NEAREST_M:g} m')
    return x, y, z


def _response(value: Any, path: str) -> Response:
    section = Section(value, path)
    time = quantity('time', 1e-6, 0.1)
    response = Response(dark_s=section.need('dark', time), bright_s=section.need('bright', time))
    section.end()
    return response


def _wander(value: Any, path: str) -> Wander:
    section = Section(value, path)
    wander = Wander(
        across_m=section.need('across', quantity('length', 0)),
        along_m=section.need('along', quantity('length', 0)),
        period_s=section.need('period', quantity('time', 0.1)),
    )
    section.end()
    return wander


def _occlusion(value: Any, path: str) -> Occlusion:
    section = Section(value, path)
    occlusion = Occlusion(
        every_s=section.need('every', quantity('time', 1e-3)),
        lasting_s=section.need('lasting', quantity('time', 0)),
    )
    section.end()
    if occlusion.lasting_s >= occlusion.every_s:
        raise ConfigError(f'{path}.lasting: the marker would never be seen; less than every')
    return occlusion


def _marker(value: Any, path: str) -> Marker:
    section = Section(value, path)
    identity = section.need('id', integer(0, IDS - 1))
    marker = Marker(
        id=identity,
        position_m=section.need('position', _position),
        name=section.take('name', f'marker_{identity}', text),
        size_m=section.take('size', Marker.size_m, quantity('length', 1e-3, 1)),
        yaw_rad=section.take('yaw', 0.0, quantity('angle', -math.pi / 2, math.pi / 2)),
        bit_period_s=section.take('bit_period', BIT_PERIOD_S, quantity('time', 1e-3, 10)),
        clock_error=section.take('clock_error', 0.0, quantity('share', -0.05, 0.05)),
        start_s=section.take('start', 0.0, quantity('time', 0)),
        packets=section.take('packets', None, integer(1, 2**31)),
        gap_bits=section.take('gap_bits', 0, integer(0, 10_000)),
        response=section.take('response', None, _response),
        wander=section.take('wander', None, _wander),
        occlusion=section.take('occlusion', None, _occlusion),
    )
    section.end()
    if marker.wander and marker.position_m[2] - marker.wander.along_m < _NEAREST_M:
        raise ConfigError(f'{path}.wander.along: the marker would reach the sensor')
    if marker.response:
        slowest_s = max(marker.response.dark_s, marker.response.bright_s)
        if slowest_s > marker.bit_period_s / 2:
            raise ConfigError(f'{path}.response: too slow to follow the bits; at most half a bit')
    return marker


def _surface(value: Any, path: str, grid: ZoneGrid) -> Surface:
    section = Section(value, path)

    def zones(value: Any, path: str) -> tuple[int, ...]:
        zone = integer(0, grid.zones - 1)
        return tuple(zone(*item) for item in items(value, path))

    surface = Surface(
        distance_m=section.need('distance', quantity('length', _NEAREST_M)),
        signal=section.need('signal', quantity('signal', 0)),
        zones=section.take('zones', None, zones),
    )
    section.end()
    return surface


def parse_scene(content: object) -> Scene:
    """Return the scene that nested mappings and lists describe, as read from a YAML file.

    Raises
    ------
    ConfigError
        For an unknown key, a missing unit or an impossible value; it names the key.
    """
    section = Section(content)
    sensor = section.take('sensor', Sensor(), _sensor)

    def markers(value: Any, path: str) -> tuple[Marker, ...]:
        return tuple(_marker(*item) for item in items(value, path))

    def surfaces(value: Any, path: str) -> tuple[Surface, ...]:
        return tuple(_surface(*item, sensor.grid) for item in items(value, path))

    scene = Scene(
        description=section.take('description', '', text),
        seed=section.take('seed', 0, integer(0, 2**63 - 1)),
        duration_s=section.take('duration', Scene.duration_s, quantity('time', 0.1)),
        sensor=sensor,
        markers=section.take('markers', (), markers),
        surfaces=section.take('surfaces', (), surfaces),
        ambient=section.take('ambient', 0.0, quantity('signal', 0)),
    )
    section.end()
    return scene
