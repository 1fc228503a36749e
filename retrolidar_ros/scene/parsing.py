# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scene files to scenes, every quantity with its unit."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, TypeVar

from retrolidar_ros.marker.code import BIT_PERIOD_S, IDS
from retrolidar_ros.scene.description import (
    NEAREST_M,
    Marker,
    MovingSurface,
    Noise,
    Occlusion,
    Ranging,
    Response,
    Scene,
    SecondSensor,
    Sensor,
    Surface,
    Wander,
    Waypoint,
)
from retrolidar_ros.sensor.frame import ZONE_SHAPES, ZoneGrid
from retrolidar_ros.settings.section import ConfigError, Section, integer, items, quantity, text

T = TypeVar('T')


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
        offset=section.take('offset', 0.0, quantity('length', -0.5, 0.5)),
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
        saturation=section.take('saturation', math.inf, quantity('signal', 1)),
        crosstalk=section.take('crosstalk', 0.0, quantity('signal', 0)),
        second_sensor=section.take('second_sensor', None, _second_sensor),
        path=section.take('path', (), _path(_triple)),
    )
    section.end()
    if sensor.jitter_s * 4 >= sensor.period_s * (1 + sensor.period_error):
        raise ConfigError(f'{path}.jitter: frames would overtake each other; less than period / 4')
    return sensor


def _second_sensor(value: Any, path: str) -> SecondSensor:
    section = Section(value, path)
    second = SecondSensor(
        ambient=section.need('ambient', quantity('signal', 0)),
        period_s=section.need('period', quantity('time', 1e-3, 10)),
        lasting_s=section.need('lasting', quantity('time', 0)),
    )
    section.end()
    if second.lasting_s > second.period_s:
        raise ConfigError(f'{path}.lasting: is longer than its period')
    return second


def _path(place: Callable[[Any, str], tuple[float, float, float]]) -> Any:
    """Return a parser of waypoints, whose positions a function parses."""

    def parse(value: Any, path: str) -> tuple[Waypoint, ...]:
        angle = quantity('angle', -math.pi / 2, math.pi / 2)
        found = []
        for item in items(value, path):
            section = Section(*item)
            found.append(
                Waypoint(
                    time_s=section.need('time', quantity('time', 0)),
                    position_m=section.need('position', place),
                    yaw_rad=section.take('yaw', 0.0, angle),
                    pitch_rad=section.take('pitch', 0.0, angle),
                )
            )
            section.end()
        if not found:
            raise ConfigError(f'{path}: needs a waypoint')
        if any(after.time_s <= before.time_s for before, after in pairwise(found)):
            raise ConfigError(f'{path}: times must rise')
        return tuple(found)

    return parse


def _triple(value: Any, path: str) -> tuple[float, float, float]:
    parts = items(value, path)
    if len(parts) != 3:
        raise ConfigError(f'{path}: needs x, y and z, not {len(parts)} values')
    x, y, z = (quantity('length')(*part) for part in parts)
    return x, y, z


def _position(value: Any, path: str) -> tuple[float, float, float]:
    x, y, z = _triple(value, path)
    if z < NEAREST_M:
        raise ConfigError(f'{path}: z of {z:g} m is impossible; at least {NEAREST_M:g} m')
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
        signal_at_1_m=section.take('signal_at_1_m', Marker.signal_at_1_m, quantity('signal', 1e-3)),
        contrast=section.take('contrast', 1.0, quantity('share', 0, 1)),
        response=section.take('response', None, _response),
        wander=section.take('wander', None, _wander),
        occlusion=section.take('occlusion', None, _occlusion),
    )
    section.end()
    if marker.wander and marker.position_m[2] - marker.wander.along_m < NEAREST_M:
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
        distance_m=section.need('distance', quantity('length', NEAREST_M)),
        signal=section.need('signal', quantity('signal', 0)),
        zones=section.take('zones', None, zones),
    )
    section.end()
    return surface


def _moving_surface(value: Any, path: str) -> MovingSurface:
    section = Section(value, path)
    surface = MovingSurface(
        width_m=section.need('width', quantity('length', 1e-3)),
        signal=section.need('signal', quantity('signal', 0)),
        path=section.need('path', _path(_position)),
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

    def all_of(parse: Callable[[Any, str], T]) -> Callable[[Any, str], tuple[T, ...]]:
        return lambda value, path: tuple(parse(*item) for item in items(value, path))

    def surface(value: Any, path: str) -> Surface:
        return _surface(value, path, sensor.grid)

    scene = Scene(
        description=section.take('description', '', text),
        seed=section.take('seed', 0, integer(0, 2**63 - 1)),
        duration_s=section.take('duration', Scene.duration_s, quantity('time', 0.1)),
        sensor=sensor,
        markers=section.take('markers', (), all_of(_marker)),
        surfaces=section.take('surfaces', (), all_of(surface)),
        moving_surfaces=section.take('moving_surfaces', (), all_of(_moving_surface)),
        ambient=section.take('ambient', 0.0, quantity('signal', 0)),
    )
    section.end()
    return scene
