# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sweeps of the paper (§6.2, §6.4): Fig. 8a, 8b and 11."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench.judging import Options
from evaluation.bench.recordings import Path, Sent, record, signal_at
from evaluation.bench.stresses import PLAIN
from evaluation.experiments.sweeps import MOST_BITS, Curve, Sweep, end_of, point_of
from evaluation.report.charts import SHADES, WRONG, draw_reads, legend_below, new_chart
from evaluation.report.claims import NOTHING, Claim, Claims, claim_of, told
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT, received_signal
from retrolidar_ros.scene.reference import NOISE, SENSOR, WALL_SIGNAL
from retrolidar_ros.scene.truth import PACKET_S
from retrolidar_ros.sensor.frame import Floats

LOOK_S = 0.45  # after the last packet: when the next look at several of them is due, at the latest
PAPER_REACH_M, PAPER_SURE_M, PAPER_FOUND_M = 2.6, 2.0, 2.8
PAPER_SMALL_M, PAPER_ANGLE_DEG, PAPER_YAW_DEG = 1.3, 25, 50
PAPER_LOSS_M, PAPER_OUTDOORS_M = 0.2, 1.0
PAPER_CLEAN, PAPER_BROKEN = 0.89, 0.48
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


class Reading(Sweep):
    """Distance, and how many of the bits that were read rightly had been wrong."""

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw shares over distance, and the wrong bits of both methods."""
        figure, ((shares, *bits),) = new_chart(1, 3, 16, 5.6, self._message)
        (points,) = (curve['points'] for curve in figures['curves'].values())
        draw_reads(shares, points)
        places = [point['place'] for point in points]
        found = [100 * point['paper']['found'] for point in points]
        shares.plot(places, found, color='0.3', linestyle='-.', linewidth=1)
        shares.axvline(PAPER_REACH_M, color='0.2', linestyle=':')
        shares.set_ylabel('lone packets [%]')
        shares.set_title('identified', fontsize=12)
        for axis, method in zip(bits, METHODS, strict=True):
            below = np.zeros(len(points))
            for wrong in range(MOST_BITS + 1):
                read = np.array(
                    [
                        100 * point[method]['bits'][wrong] / point[method]['right']['trials']
                        for point in points
                    ]
                )
                label = f'{wrong}' if wrong < MOST_BITS else f'{MOST_BITS} or more'
                axis.bar(range(len(places)), read, 0.8, below, color=SHADES[wrong], label=label)
                below += read
            axis.set_xticks(range(len(places)), [f'{place:g}' for place in places])
            axis.set_ylim(0, 103)
            axis.set_title(f'{method}: wrong bits of what is read rightly', fontsize=12)
            axis.grid(axis='x', visible=False)
        bits[1].legend(title='wrong bits', fontsize=10, framealpha=1, loc='upper right')
        for axis in (shares, *bits):
            axis.set_xlabel(self._axis)
        others: dict[str, Any] = {
            **WRONG,
            '`paper`: preamble found'.replace('`', ''): {'color': '0.3', 'linestyle': '-.'},
            "80 % of the paper's own": {'color': '0.2', 'linestyle': ':'},
        }
        legend_below(figure, METHODS, others)
        return figure


def _ends(figures: dict[str, Any], curve: str) -> list[float | None]:
    return [end_of(figures, curve, method) for method in reversed(METHODS)]


def _reaches(ends: Sequence[float | None], least: float, unit: str = 'm', digits: int = 2) -> Claim:
    """Return a claim that agrees if the default reaches as far as the paper."""
    default = ends[-1]
    words = (told(one, unit, digits) for one in ends)
    return claim_of(words, default is not None and default >= least)


def _shares(values: Sequence[float | None], agrees: bool | None = None) -> Claim:
    words = (NOTHING if value is None else f'{value:.0%}' for value in values)
    return claim_of(words, agrees)


def _reading_claims(figures: dict[str, Any]) -> Claims:
    near, sure, far = (
        point_of(figures, '3 cm', place) for place in (1.0, PAPER_SURE_M, PAPER_FOUND_M)
    )

    def of(point: Mapping[str, Any], key: str) -> list[float]:
        return [point[method][key]['rate'] for method in reversed(METHODS)]

    def clean(point: Mapping[str, Any]) -> list[float]:
        bits = [point[method]['bits'] for method in reversed(METHODS)]
        return [one[0] / max(1, sum(one)) for one in bits]

    found = [far[method]['found'] for method in reversed(METHODS)]
    broken = [1 - one for one in clean(far)]
    read = of(sure, 'right')
    return {
        'reach': _reaches(_ends(figures, '3 cm'), PAPER_REACH_M),
        'sure': _shares(read, read[1] > 0.98),
        'found': _shares(found, found[0] > 0.98),
        'wrong': _shares(of(near, 'wrong')),
        'clean': _shares(clean(sure), abs(clean(sure)[0] - PAPER_CLEAN) < 0.06),
        'broken': _shares(broken, abs(broken[0] - PAPER_BROKEN) < 0.08),
    }


def _reach_claims(figures: dict[str, Any]) -> Claims:
    point = point_of(figures, '3 cm, 3 packets', PAPER_FOUND_M)
    three = [point[method]['right']['rate'] for method in reversed(METHODS)]
    return {
        'small': _reaches(_ends(figures, '1 cm, one packet'), PAPER_SMALL_M),
        'three': _shares(three, three[1] > 0.97),
    }


def _size_claims(figures: dict[str, Any]) -> Claims:
    known = [(float(name.split()[0]), end_of(figures, name, 'joint')) for name in figures['curves']]
    areas, ends = np.array([one for one in known if one[1] is not None], dtype=float).T
    power = float(np.polyfit(np.log(areas), np.log(ends), 1)[0])
    paper = math.log(PAPER_REACH_M / PAPER_SMALL_M) / math.log(9)
    return {'power': Claim(default=f'{power:.2f}', agrees=abs(power - paper) < 0.03)}


def _angle_claims(figures: dict[str, Any]) -> Claims:
    return {'angle': _reaches(_ends(figures, 'at 1 m'), PAPER_ANGLE_DEG, '°', 1)}


def _yaw_claims(figures: dict[str, Any]) -> Claims:
    return {'yaw': _reaches(_ends(figures, 'at 1 m'), PAPER_YAW_DEG, '°', 1)}


def _ambient_claims(figures: dict[str, Any]) -> Claims:
    dark, day, shade = (
        _ends(figures, light) for light in ('dark', 'daylight in a room', 'shade outdoors')
    )
    lost = [
        None if before is None or after is None else before - after
        for before, after in zip(dark, day, strict=True)
    ]
    near = lost[1] is not None and abs(lost[1] - PAPER_LOSS_M) < 0.1
    return {'loss': claim_of(map(told, lost), near), 'outdoors': _reaches(shade, PAPER_OUTDOORS_M)}


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
        _reading_claims,
        {},
    ),
    'reach': Sweep(
        'Reach over several packets',
        'Packets that are added up reach farther',
        'distance [m]',
        'm',
        _ONE_OR_MORE,
        _reach_claims,
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
        _size_claims,
        {'1 cm²': PAPER_SMALL_M, '9 cm²': PAPER_REACH_M},
    ),
    'angle': Sweep(
        'Angle from the axis',
        'Markers are read to the edge of the view',
        'angle from the axis [°]',
        '°',
        [Curve('at 1 m', _aside, (0, 6, 12, 18, 21, 22, 23, 24, 25, 26, 28), 32)],
        _angle_claims,
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
        _yaw_claims,
        {'at 1 m': PAPER_YAW_DEG},
    ),
    'ambient': Sweep(
        'Ambient light',
        'Daylight in a room costs decimetres of reach, the shade outdoors half of it',
        'distance of a marker of 3 cm [m]',
        'm',
        _curves(
            {name: partial(_lit, light=light) for name, light in LIGHTS.items()},
            {name: _where_lit(light) for name, light in LIGHTS.items()},
            4,
        ),
        _ambient_claims,
        {},
    ),
}
