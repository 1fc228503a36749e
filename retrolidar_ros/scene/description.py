# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What a scene may name, and how its file says it. What it does not name is not computed."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import numpy as np

from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS
from retrolidar_ros.sensor.frame import GRIDS, Floats, ZoneGrid
from retrolidar_ros.settings.files import load_parsed, shared_file
from retrolidar_ros.settings.section import (
    ConfigError,
    Triple,
    each,
    integer,
    mapping,
    place,
    quantity,
    text,
)

NEAREST_M = 1e-3
MAX_SEED = 2**63 - 1
MARKER_SIZE_M = 0.03  # edge of the paper's retroreflector (§5)
SIGNAL_AT_1_M = 360.0
"""Of 9 cm² facing the sensor [kcps/SPAD], from paper §3.2 and §4: a bare retroreflector of that
size returns 100.4 times what a board does, which is 4 kcps/SPAD at 1.4 m; the crystal's polarisers
let a quarter of it pass."""
_TIME_CONSTANTS = math.log(9)  # in which an exponential runs from 10 to 90 %

Angle: TypeAlias = Annotated[float, quantity('angle', -math.pi / 2, math.pi / 2)]
ClockError: TypeAlias = Annotated[float, quantity('share', -0.05, 0.05)]  # of a period
Length: TypeAlias = Annotated[float, quantity('length', 0)]
Period: TypeAlias = Annotated[float, quantity('time', 1e-3, 10)]
ResponseTime: TypeAlias = Annotated[float, quantity('time', 1e-6, 0.1)]
Share: TypeAlias = Annotated[float, quantity('share', 0, 1)]
Signal: TypeAlias = Annotated[float, quantity('signal', 0)]  # [kcps/SPAD]
Time: TypeAlias = Annotated[float, quantity('time', 0)]


@dataclass(frozen=True)
class Noise:
    """Frame-to-frame variance of the signal: floor + slope · signal + ambient · ambient light."""

    floor: Annotated[float, quantity('variance', 0)]  # [(kcps/SPAD)²]
    slope: Signal
    ambient: Signal = 0.0


@dataclass(frozen=True)
class Ranging:
    """Standard deviation of the distance [m]: hypot(shot / signal, floor)."""

    shot: Length  # at a signal of one kcps/SPAD
    floor: Length
    offset: Annotated[float, quantity('length', -0.5, 0.5)] = 0.0  # excess of all ranges [m]


def _check_second_sensor(second: SecondSensor, path: str) -> None:
    if second.lasting_s > second.period_s:
        raise ConfigError(f'{path}.lasting: is longer than its period')


@dataclass(frozen=True)
class SecondSensor:
    """Another sensor, not in step with this one, whose light is part of what this one sees."""

    ambient: Signal  # by how much it raises the ambient light while it sends
    period_s: Period
    lasting_s: Time  # how long it sends in each of its periods


@dataclass(frozen=True)
class Waypoint:
    """Where something is at a time; between two it moves evenly, after the last it restarts."""

    time_s: Time
    position_m: Annotated[Triple, place()]
    yaw_rad: Angle = 0.0  # to the right
    pitch_rad: Angle = 0.0  # upwards


def _waypoints(value: Any, path: str) -> tuple[Waypoint, ...]:
    found = each(mapping(Waypoint))(value, path)
    if not found:
        raise ConfigError(f'{path}: needs a waypoint')
    if any(after.time_s <= before.time_s for before, after in pairwise(found)):
        raise ConfigError(f'{path}: times must rise')
    return found


def _grid(value: Any, path: str) -> ZoneGrid:
    shapes = {f'{rows}x{columns}': grid for (rows, columns), grid in GRIDS.items()}
    if not isinstance(value, str) or value not in shapes:
        raise ConfigError(f'{path}: {value!r} is not {" or ".join(shapes)}')
    return shapes[value]


def _check_sensor(sensor: Sensor, path: str) -> None:
    if sensor.jitter_s * 4 >= sensor.period_s * (1 + sensor.period_error):
        raise ConfigError(f'{path}.jitter: frames would overtake each other; less than period / 4')


@dataclass(frozen=True)
class Sensor:
    """The LiDAR and its clock."""

    grid: Annotated[ZoneGrid, _grid, 'zones'] = ZoneGrid()
    period_s: Period = 0.021
    period_error: ClockError = 0.0  # of the frame period
    clock_error: ClockError = 0.0  # of the clock that stamps the frames
    jitter_s: Annotated[float, quantity('time', 0, 5e-3)] = 0.0  # deviation of a frame's time
    blur: Share = 0.0  # standard deviation of the optical blur, as a share of a zone's width
    noise: Annotated[Noise | None, mapping(Noise)] = None
    ranging: Annotated[Ranging | None, mapping(Ranging)] = None
    target_threshold: Signal = 0.0  # least signal of a target; 0 = the last digit suffices
    lost: Annotated[float, quantity('share', 0, 0.99)] = 0.0  # share of frames that never arrive
    abnormal: Share = 0.0  # share of samples with an abnormal status and meaningless values
    saturation: Annotated[float, quantity('signal', 1)] = math.inf
    """The most that a SPAD can count, one over its dead time [kcps/SPAD]."""
    crosstalk: Signal = 0.0  # what a cover glass throws back, a target of its own at the sensor
    second_sensor: Annotated[SecondSensor | None, mapping(SecondSensor, _check_second_sensor)] = (
        None
    )
    path: Annotated[tuple[Waypoint, ...], _waypoints] = ()  # poses; none = at the origin


@dataclass(frozen=True)
class Response:
    """Times in which a liquid crystal darkens and brightens, from 10 to 90 % [s] (paper §2.2)."""

    dark_s: ResponseTime
    bright_s: ResponseTime

    def integral(self, before: Floats, level: Floats, elapsed_s: Floats) -> Floats:
        """Return the integral of the relaxation from one level to the next [s].

        Levels are transmissions, 0 to 1, and `elapsed_s` is the time since the edge between them;
        their shapes (...) are broadcast. A bit lasts many time constants, so it starts at the level
        `before`.
        """
        before, level, elapsed_s = np.broadcast_arrays(before, level, elapsed_s)
        step = before - level
        tau = np.where(step > 0, self.dark_s, self.bright_s) / _TIME_CONSTANTS
        share = np.divide(elapsed_s, tau, out=np.full_like(elapsed_s, np.inf), where=tau > 0)
        gone = np.expm1(-np.maximum(share, 0.0))  # before the edge nothing has changed
        integral: Floats = level * elapsed_s - step * tau * gone
        return integral


@dataclass(frozen=True)
class Wander:
    """A smooth motion about the marker's position: slow sines of unlike periods."""

    across_m: Length  # amplitude along x and along y
    along_m: Length  # amplitude along z
    period_s: Annotated[float, quantity('time', 0.1)]


def _check_occlusion(occlusion: Occlusion, path: str) -> None:
    if occlusion.lasting_s >= occlusion.every_s:
        raise ConfigError(f'{path}.lasting: the marker would never be seen; less than every')


@dataclass(frozen=True)
class Occlusion:
    """Something that hides the marker again and again."""

    every_s: Annotated[float, quantity('time', 1e-3)]
    lasting_s: Time


def _check_ahead(position_m: Triple, path: str) -> None:
    z = position_m[2]
    if z < NEAREST_M:
        raise ConfigError(f'{path}: z of {z:g} m is impossible; at least {NEAREST_M:g} m')


def _waypoints_ahead(value: Any, path: str) -> tuple[Waypoint, ...]:
    found = _waypoints(value, path)
    for index, point in enumerate(found):
        _check_ahead(point.position_m, f'{path}[{index}].position')
    return found


def _check_marker(marker: Marker, path: str) -> None:
    if math.isnan(marker.position_m[2]):
        raise ConfigError(f'{path}.position: is missing')
    _check_ahead(marker.position_m, f'{path}.position')
    if marker.wander and marker.position_m[2] - marker.wander.along_m < NEAREST_M:
        raise ConfigError(f'{path}.wander.along: the marker would reach the sensor')
    response = marker.response
    if response and max(response.dark_s, response.bright_s) > marker.bit_period_s / 2:
        raise ConfigError(f'{path}.response: too slow to follow the bits; at most half a bit')


@dataclass(frozen=True)
class Marker:
    """A liquid-crystal marker."""

    id: Annotated[int, integer(0, IDS - 1)]
    position_m: Annotated[Triple, place()] = (math.nan, math.nan, math.nan)
    """In the optical frame: x right, y down, z forward; of one on a path where it begins."""
    name: Annotated[str, text] = ''  # if none is given, that of its ID
    size_m: Annotated[float, quantity('length', 1e-3, 1)] = MARKER_SIZE_M  # edge of its square
    yaw_rad: Angle = 0.0
    bit_period_s: Period = BIT_PERIOD_S
    clock_error: ClockError = 0.0  # of the bit period
    start_s: Time = 0.0  # when its first packet begins; it is bright before
    packets: Annotated[int | None, integer(1, 2**31)] = None  # None = without end
    gap_bits: Annotated[int, integer(0, 10_000)] = 0
    signal_at_1_m: Annotated[float, quantity('signal', 1e-3), 'signal_at_1_m'] = SIGNAL_AT_1_M
    """Of a bright 3 cm one facing the sensor [kcps/SPAD]."""
    contrast: Share = 1.0  # share of its light that a dark crystal blocks
    response: Annotated[Response | None, mapping(Response)] = None
    wander: Annotated[Wander | None, mapping(Wander)] = None
    path: Annotated[tuple[Waypoint, ...], _waypoints_ahead] = ()
    """Positions in the frame of the scene, instead of one; it does not turn."""
    occlusion: Annotated[Occlusion | None, mapping(Occlusion, _check_occlusion)] = None

    def __post_init__(self) -> None:
        """Name it, and place it at the beginning of its path."""
        if self.path and math.isnan(self.position_m[2]):
            object.__setattr__(self, 'position_m', self.path[0].position_m)
        object.__setattr__(self, 'name', self.name or f'marker_{self.id}')


@dataclass(frozen=True)
class Surface:
    """A background at one distance along the optical axis."""

    distance_m: Annotated[float, quantity('length', NEAREST_M)]
    signal: Signal
    zones: Annotated[tuple[int, ...] | None, each(integer(0, ZoneGrid(8, 8).zones - 1))] = None
    """Where it is seen; None = in every zone."""


@dataclass(frozen=True)
class MovingSurface:
    """A dull square facing the sensor, such as a hand, on a path; it hides what is behind it."""

    width_m: Annotated[float, quantity('length', 1e-3)]
    signal: Signal  # of a zone that it fills at 1 m
    path: Annotated[tuple[Waypoint, ...], _waypoints_ahead]


def _check_scene(scene: Scene, _: str) -> None:
    zone = integer(0, scene.sensor.grid.zones - 1)
    for index, surface in enumerate(scene.surfaces):
        each(zone)(list(surface.zones or ()), f'surfaces[{index}].zones')


@dataclass(frozen=True)
class Scene:
    """Everything that a simulation computes."""

    description: Annotated[str, text] = ''
    seed: Annotated[int, integer(0, MAX_SEED)] = 0
    duration_s: Annotated[float, quantity('time', 0.1)] = 30.0
    sensor: Annotated[Sensor, mapping(Sensor, _check_sensor)] = Sensor()
    markers: Annotated[tuple[Marker, ...], each(mapping(Marker, _check_marker))] = ()
    surfaces: Annotated[tuple[Surface, ...], each(mapping(Surface))] = ()
    moving_surfaces: Annotated[tuple[MovingSurface, ...], each(mapping(MovingSurface))] = ()
    ambient: Signal = 0.0


def parse_scene(content: object) -> Scene:
    """Return the scene that a YAML file describes; ConfigError as of `mapping`."""
    return mapping(Scene, _check_scene)(content, '')


def scene_names() -> list[str]:
    """Return the names of the scenes that ship with the package."""
    return sorted(path.stem for path in shared_file('config/scenes').glob('*.yaml'))


def find_scene(name: str) -> Path:
    """Return the file of a scene by path or name; FileNotFoundError, with all names, if none is."""
    if Path(name).is_file():
        return Path(name)
    shipped = shared_file('config/scenes') / f'{name}.yaml'
    if shipped.is_file():
        return shipped
    known = ', '.join(scene_names())
    raise FileNotFoundError(f'there is no scene {name}; give a file, or one of {known}')


def load_scene(name: str) -> Scene:
    """Return a scene by path or name; errors as of `find_scene` and `load_parsed`."""
    return load_parsed(find_scene(name), parse_scene)
