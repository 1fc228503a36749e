# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sweeps of the paper (§6.2, §6.4): Fig. 8a, 8b and 11."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from evaluation.bench.judging import Options
from evaluation.bench.recordings import Path, Sent, record, signal_at
from evaluation.bench.stresses import PLAIN
from evaluation.experiments.sweep_claims import (
    PAPER_ANGLE_DEG,
    PAPER_REACH_M,
    PAPER_SMALL_M,
    PAPER_YAW_DEG,
    Reading,
    ambient_claims,
    angle_claims,
    reach_claims,
    reading_claims,
    size_claims,
    yaw_claims,
)
from evaluation.experiments.sweeps import Curve, Sweep
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, received_signal
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL
from retrolidar_ros.scene.truth import PACKET_S
from retrolidar_ros.sensor.frame import Floats

LOOK_S = 0.45  # after the last packet: when the next look at several of them is due, at the latest
LIGHTS = {'dark': 0.0, 'lamps at night': 2.0, 'daylight in a room': 24.0, 'shade outdoors': 1000.0}
"""Ambient light at 940 nm as the sensor reports it [kcps/SPAD].

Public captures have 1 to 28 indoors; outdoors is forty times daylight in a room, as 20 000 lux
are to 500.
"""
_DAZZLED = replace(SENSOR, noise=replace(NOISE, ambient=NOISE.slope))
_BLURRED = replace(SENSOR, blur=0.05)
_RANGES_M = (1.0, 1.5, 2.0, 2.2, 2.4, 2.6, 2.7, 2.8, 2.9, 3.0, 3.2, 3.4)
_LIKE_M = (1.8, 2.2, 2.4, 2.6, 2.7, 2.8, 2.9, 3.0, 3.2)
_OF_SEVERAL_M = (2.4, 2.8, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0)


def lone(
    range_m: float, rng: np.random.Generator, *, size_m: float = 0.03, yaw_deg: float = 0.0
) -> Sent:
    """Return lone packets of markers in all zones at a distance."""
    at = np.array(range_m)
    signal = float(received_signal(at, size_m**2, math.radians(yaw_deg)))
    return record(PLAIN, signal, rng, USABLE_IDS, range_m=range_m)


def repeating(range_m: float, rng: np.random.Generator, *, size_m: float, packets: int) -> Sent:
    """Return markers that repeat, for a time of some packets."""
    signal = float(received_signal(np.array(range_m), size_m**2, 0.0))
    lasting_s = packets * PACKET_S + LOOK_S
    return record(PLAIN, signal, rng, USABLE_IDS, range_m=range_m, repeated_s=lasting_s)


def _turned(yaw_deg: float, rng: np.random.Generator, *, range_m: float) -> Sent:
    return lone(range_m, rng, yaw_deg=yaw_deg)


def _standing(position_m: Floats) -> Path:
    return lambda time_s: np.repeat(position_m[None], len(time_s), axis=0)


def _aside(angle_deg: float, rng: np.random.Generator) -> Sent:
    """Return one marker at 1 m, at an angle from the axis, half-way between two rows of zones."""
    angle = math.radians(angle_deg)
    path = _standing(np.array([math.sin(angle), 0.0, math.cos(angle)]))
    signal = signal_at(1.0)
    return record(PLAIN, signal, rng, USABLE_IDS, range_m=1.0, sensor=_BLURRED, path=path)


def _lit(range_m: float, rng: np.random.Generator, *, light: float) -> Sent:
    return record(PLAIN, signal_at(range_m), rng, USABLE_IDS, sensor=_DAZZLED, ambient=light)


def _several(packets: int) -> dict[str, Options]:
    return {method: {'method': method, 'max_packets': packets} for method in METHODS}


def _alike(size_m: float) -> tuple[float, ...]:
    """Return where a marker is as bright as one of 3 cm where its reach ends."""
    factor = (size_m / 0.03) ** (-2 / DISTANCE_EXPONENT)
    return tuple(round(factor * place, 3) for place in _LIKE_M)


def _where_lit(light: float) -> tuple[float, ...]:
    """Return where a marker stands out of noise as it does in the dark where its reach ends."""
    dark = NOISE.floor + NOISE.slope * WALL_SIGNAL
    louder = (dark + NOISE.slope * light) / dark
    return tuple(round(place * louder ** (0.5 / DISTANCE_EXPONENT), 3) for place in _LIKE_M)


def _curves(
    makers: Mapping[str, Callable[[float, np.random.Generator], Sent]],
    places: Mapping[str, tuple[float, ...]],
    recordings: int,
) -> list[Curve]:
    return [Curve(name, make, places[name], recordings) for name, make in makers.items()]


_AREAS = {f'{1e4 * size_m**2:g} cm²': size_m for size_m in (0.01, 0.015, 0.02, 0.025, 0.03)}
_ONE_OR_MORE = [
    Curve('1 cm, one packet', partial(lone, size_m=0.01), _alike(0.01), 4),
    *(
        Curve(
            f'{size} cm, {packets} packets',
            partial(repeating, size_m=size / 100, packets=packets),
            tuple(
                round(place * (size / 3) ** (-2 / DISTANCE_EXPONENT), 3) for place in _OF_SEVERAL_M
            ),
            3,
            _several(packets),
            lone=False,
        )
        for size in (3, 1)
        for packets in (3, 8)
    ),
]
SWEEPS: dict[str, Sweep] = {
    'reading': Reading(
        'Reading over distance',
        'The code mends bits to the end of the reach; the default needs no clean ones',
        'distance of a marker of 3 cm [m]',
        'm',
        [Curve('3 cm', lone, _RANGES_M, 8)],
        reading_claims,
        {},
    ),
    'reach': Sweep(
        'Reach over several packets',
        'Packets that are added up reach farther',
        'distance [m]',
        'm',
        _ONE_OR_MORE,
        reach_claims,
        {'1 cm, one packet': PAPER_SMALL_M},
    ),
    'size': Sweep(
        'Size of the marker',
        'The reach grows with the fourth root of the area, about',
        'distance [m]',
        'm',
        _curves(
            {name: partial(lone, size_m=size_m) for name, size_m in _AREAS.items()},
            {name: _alike(size_m) for name, size_m in _AREAS.items()},
            3,
        ),
        size_claims,
        {'1 cm²': PAPER_SMALL_M, '9 cm²': PAPER_REACH_M},
    ),
    'angle': Sweep(
        'Angle from the axis',
        'Markers are read to the edge of the view',
        'angle from the axis [°]',
        '°',
        [Curve('at 1 m', _aside, (0, 6, 12, 18, 21, 22, 23, 24, 25, 26, 28), 32)],
        angle_claims,
        {'at 1 m': PAPER_ANGLE_DEG},
    ),
    'yaw': Sweep(
        'Yaw of the marker',
        'Near by, a marker may be turned until no light comes back',
        'yaw [°]',
        '°',
        _curves(
            {f'at {at:g} m': partial(_turned, range_m=at) for at in (1.0, 2.0)},
            dict.fromkeys(('at 1 m', 'at 2 m'), (0, 20, 40, 50, 52, 54, 56, 57, 58, 59, 60)),
            3,
        ),
        yaw_claims,
        {'at 1 m': PAPER_YAW_DEG},
    ),
    'ambient': Sweep(
        'Ambient light',
        'Daylight in a room costs decimetres of reach, the shade outdoors a metre',
        'distance of a marker of 3 cm [m]',
        'm',
        _curves(
            {name: partial(_lit, light=light) for name, light in LIGHTS.items()},
            {name: _where_lit(light) for name, light in LIGHTS.items()},
            4,
        ),
        ambient_claims,
        {},
    ),
}
