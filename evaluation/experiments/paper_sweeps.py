# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sweeps of the paper (§6.2, §6.4): Fig. 8a, 8b and 11, beside the paper's own values."""

import math
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench.recordings import Sent, record_at, rng_at
from evaluation.experiments import sweeps
from evaluation.report.chart_style import (
    SHADES,
    WORDS,
    WRONG,
    draw_reads,
    label,
    legend_below,
    line,
    new_chart,
)
from evaluation.report.claims import (
    BOTH_CLAIMED,
    Claim,
    Claims,
    as_text,
    end_as_text,
    shares,
)
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT
from retrolidar_ros.scene.reference import NOISE, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats

PAPER_REACH_M, PAPER_SURE_M, PAPER_FOUND_M = 2.6, 2.0, 2.8
PAPER_SMALL_M, PAPER_ANGLE_DEG = 1.3, 25
LOOK_S = 0.45  # after the last packet: when the next look at several of them is due, at the latest
LONE_RECORDINGS = 8  # of lone packets of 3 cm at a distance: the same ones wherever these are read
LIGHTS = {'dark': 0.0, 'lamps at night': 2.0, 'daylight in a room': 24.0, 'shade outdoors': 1000.0}
"""Ambient light at 940 nm as the sensor reports it [kcps/SPAD].

Public captures have 1 to 28 indoors; outdoors is forty times daylight in a room, as 20 000 lux
are to 500.
"""
RANGES_M = (1.0, 1.5, 2.0, 2.2, 2.4, 2.6, 2.7, 2.8, 2.9, 3.0, 3.2, 3.4)
TAG_RANGES_M = (0.5, 0.75, 1.0, 1.5, 1.75, *RANGES_M[2:], 3.6, 3.8, 4.0, 4.2)
"""Distances of markers of 3 cm, of ours alone and of ours beside tags."""
_DISTANCE = 'distance of a marker of 3 cm [m]'
_LIKE_M = (1.8, 2.2, 2.4, 2.6, 2.7, 2.8, 2.9, 3.0, 3.2)
_OF_SEVERAL_M = (2.4, 2.8, 3.0, 3.2, 3.4, 3.6, 3.8, 4.0)


def lone_packets(range_m: float, seed: int, *, quick: bool) -> list[Sent]:
    """Return the lone packets that every experiment has at a distance."""
    rng = rng_at(seed, range_m)
    return [record_at(range_m, rng) for _ in range(1 if quick else LONE_RECORDINGS)]


def repeating(range_m: float, rng: np.random.Generator, *, size_m: float, packets: int) -> Sent:
    """Return markers that repeat, for a time of some packets."""
    return record_at(range_m, rng, size_m=size_m, repeated_s=packets * PACKET_S + LOOK_S)


def turned(yaw_deg: float, rng: np.random.Generator, *, range_m: float) -> Sent:
    """Return lone packets of markers that are turned."""
    return record_at(range_m, rng, yaw_deg=yaw_deg)


def _aside(angle_deg: float, rng: np.random.Generator) -> Sent:
    """Return one marker at 1 m, at an angle from the axis, half-way between two rows of zones."""
    angle = math.radians(angle_deg)

    def path(time_s: Floats) -> Floats:
        return np.tile([math.sin(angle), 0.0, math.cos(angle)], (len(time_s), 1))

    return record_at(1.0, rng, path=path)


def _scaled(places_m: Sequence[float], factor: float) -> tuple[float, ...]:
    return tuple(round(factor * place, 3) for place in places_m)


def _of_size(places_m: Sequence[float], size_m: float) -> tuple[float, ...]:
    """Return where a marker is as bright as one of 3 cm is at some places."""
    return _scaled(places_m, (size_m / 0.03) ** (-2 / DISTANCE_EXPONENT))


def _where_lit(light: float) -> tuple[float, ...]:
    """Return where a marker stands out of noise as it does in the dark where its reach ends."""
    dark = NOISE.floor + NOISE.slope * WALL_SIGNAL
    louder = (dark + NOISE.slope * light) / dark
    return _scaled(_LIKE_M, louder ** (0.5 / DISTANCE_EXPONENT))


def _several(size_cm: int, packets: int) -> sweeps.Curve:
    size_m = size_cm / 100
    make = partial(repeating, size_m=size_m, packets=packets)
    variants = {method: {'method': method, 'max_packets': packets} for method in METHODS}
    places_m = _of_size(_OF_SEVERAL_M, size_m)
    return sweeps.Curve(f'{size_cm} cm, {packets} packets', make, places_m, 3, variants, lone=False)


SMALL_M = _of_size(_LIKE_M, 0.01)
"""Distances of lone packets of 1 cm, of which there are `SMALL_RECORDINGS` at each."""
SMALL_RECORDINGS = 4


class Reading(sweeps.Sweep):
    """Distance, and how many of the bits that were read rightly had been wrong."""

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw shares over distance, and the wrong bits of both methods."""
        figure, (read, *bits) = new_chart(3, 3, 4.4, self.message(figures))
        (points,) = (curve['points'] for curve in figures['curves'].values())
        draw_reads(read, points)
        places = [point['place'] for point in points]
        found = [100 * point['paper']['found'] for point in points]
        read.plot(places, found, **line('-.', '0.3'), linewidth=1)
        read.axvline(PAPER_REACH_M, **line(':'))
        label(read, 'distance [m]', 'lone packets [%]', 'identified', percent=True)
        from matplotlib.patches import Patch

        names = [*map(str, range(sweeps.MAX_BITS)), f'{sweeps.MAX_BITS} or more']
        for axis, method in zip(bits, METHODS, strict=True):
            trials = [point[method]['right']['trials'] for point in points]
            heights = 100 * np.array([point[method]['bits'] for point in points]).T / trials
            for height, below, colour in zip(heights, heights.cumsum(axis=0), SHADES, strict=True):
                axis.bar(range(len(places)), height, 0.8, below - height, color=colour)
            label(axis, 'distance [m]', '', f'read, {WORDS[method]}', percent=True)
            shown = range(0, len(places), 3)
            axis.set_xticks(shown, [f'{places[index]:g}' for index in shown])
            axis.grid(axis='x', visible=False)
        handles = [Patch(color=one, label=name) for name, one in zip(names, SHADES, strict=True)]
        close = {'handlelength': 1, 'labelspacing': 0.2, 'borderaxespad': 0}
        how = {'loc': 'upper right', 'fontsize': 9, 'frameon': False} | close
        bits[-1].legend(handles=handles, title='wrong bits', **how)
        others = {'its preamble found': line('-.', '0.3'), "the paper's reach": line(':')}
        legend_below(figure, METHODS, WRONG | others)
        return figure


def _ends(figures: dict[str, Any], curve: str) -> list[float | None]:
    return [sweeps.end_of(figures, curve, method) for method in BOTH_CLAIMED]


def _read_to(figures: dict[str, Any], curve: str, unit: str = 'm') -> str:
    """Return to where the default reads, as text."""
    return as_text(sweeps.end_of(figures, curve, 'joint'), unit, 2 if unit == 'm' else 0)


def _reaches(figures: dict[str, Any], curve: str, unit: str = 'm') -> Claim:
    """Return to where both methods read."""
    ends, digits = figures['curves'][curve]['ends'], 2 if unit == 'm' else 1
    return Claim(*(end_as_text(ends[method], f'[{unit}]', digits) for method in BOTH_CLAIMED))


def _reading_claims(figures: dict[str, Any]) -> Claims:
    def at(place: float, key: str) -> list[Any]:
        return [sweeps.point_of(figures, '3 cm', place)[method][key] for method in BOTH_CLAIMED]

    clean = [
        [bits[0] / max(1, sum(bits)) for bits in at(place, 'bits')]
        for place in (PAPER_SURE_M, PAPER_FOUND_M)
    ]
    return {
        'reach': _reaches(figures, '3 cm'),
        'sure': shares(one['rate'] for one in at(PAPER_SURE_M, 'right')),
        'found': shares(at(PAPER_FOUND_M, 'found')),
        'wrong': shares(one['rate'] for one in at(1.0, 'wrong')),
        'clean': shares(clean[0]),
        'broken': shares(1 - one for one in clean[1]),
    }


def _reach_claims(figures: dict[str, Any]) -> Claims:
    point = sweeps.point_of(figures, '3 cm, 3 packets', PAPER_FOUND_M)
    return {
        'small': _reaches(figures, '1 cm, one packet'),
        'three': shares(point[method]['right']['rate'] for method in BOTH_CLAIMED),
    }


def _ambient_claims(figures: dict[str, Any]) -> Claims:
    ends = zip(_ends(figures, 'dark'), _ends(figures, 'daylight in a room'), strict=True)
    lost = [None if dark is None or day is None else dark - day for dark, day in ends]
    return {'loss': Claim(*map(as_text, lost)), 'outdoors': _reaches(figures, 'shade outdoors')}


SWEEPS: dict[str, sweeps.Sweep] = {
    'reading': Reading(
        'Reading over distance',
        lambda got: f'Lone packets of 3 cm are read to {_read_to(got, "3 cm")}',
        _DISTANCE,
        [sweeps.Curve('3 cm', record_at, RANGES_M, LONE_RECORDINGS)],
        _reading_claims,
    ),
    'reach': sweeps.Sweep(
        'Reach over several packets',
        lambda got: (
            f'Eight packets added up: 1 cm is read to {_read_to(got, "1 cm, 8 packets")} '
            f'instead of {_read_to(got, "1 cm, one packet")}'
        ),
        'distance [m]',
        [
            sweeps.Curve(
                '1 cm, one packet', partial(record_at, size_m=0.01), SMALL_M, SMALL_RECORDINGS
            ),
            *(_several(size_cm, packets) for size_cm in (1, 3) for packets in (3, 8)),
        ],
        _reach_claims,
        {'1 cm, one packet': PAPER_SMALL_M},
    ),
    'angle': sweeps.Sweep(
        'Angle from the axis',
        lambda got: f'Markers are read to {_read_to(got, "at 1 m", "°")} from the axis',
        'angle from the axis [°]',
        [sweeps.Curve('at 1 m', _aside, (0, 6, 12, 18, 21, 22, 23, 24, 25, 26, 28), 32)],
        lambda got: {'angle': _reaches(got, 'at 1 m', '°')},
        {'at 1 m': PAPER_ANGLE_DEG},
    ),
    'ambient': sweeps.Sweep(
        'Ambient light',
        lambda got: (
            f'3 cm are read to {_read_to(got, "dark")} in the dark, to '
            f'{_read_to(got, "daylight in a room")} by daylight, '
            f'to {_read_to(got, "shade outdoors")} in the shade outdoors'
        ),
        _DISTANCE,
        [
            sweeps.Curve(name, partial(record_at, ambient=light), _where_lit(light), 4)
            for name, light in LIGHTS.items()
        ],
        _ambient_claims,
    ),
}
