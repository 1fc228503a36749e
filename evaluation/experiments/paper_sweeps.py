# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The sweeps of the paper (§6.2, §6.4): Fig. 8a, 8b and 11, beside the paper's own values.

All follow the paper's way: lone packets, and four of five identified count as read.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench.judging import BOTH, Options, judge_all, read_of
from evaluation.bench.rates import LEVEL, crossing, nearest
from evaluation.bench.recordings import Sent, record_at, rng_at, standing
from evaluation.report import chart_style as charts
from evaluation.report.chart_style import WRONG, label, line
from evaluation.report.claims import BOTH_CLAIMED, Claim, Claims, as_text, end_as_text, shares
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.code import PACKET_S
from retrolidar_ros.scene.description import MARKER_SIZE_M
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT
from retrolidar_ros.scene.reference import NOISE, WALL_SIGNAL

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
_MAX_BITS = 4  # so many wrong bits or more are counted together
_PAPERS_OWN = {"80 % of the paper's own": line(':')}  # entry of a legend


@dataclass(frozen=True)
class Curve:
    """One panel: places, and what makes a recording at each."""

    name: str
    make: Callable[[float, np.random.Generator], Sent]
    places: Sequence[float]
    recordings: int = 3  # of sixteen markers, or of one
    variants: Mapping[str, Options] = field(default_factory=lambda: BOTH)
    lone: bool = True


def _point(curve: Curve, place: float, recordings: int, seed: int) -> dict[str, Any]:
    make, rng = partial(curve.make, place), rng_at(seed, place)
    found = judge_all(make, recordings, rng, curve.variants, lone=curve.lone)
    point: dict[str, Any] = {'place': place}
    for name, rows in found.items():
        bits = [min(one.corrected_bits, _MAX_BITS) for row in rows for one in row.own]
        markers = sum(len(row.right) for row in rows)
        point[name] = {
            **read_of(rows),
            'bits': np.bincount(np.array(bits, dtype=int), minlength=_MAX_BITS + 1).tolist(),
            'found': sum(min(row.candidates, len(row.right)) for row in rows) / markers,
        }
    return point


def ends_of(points: Sequence[Mapping[str, Any]], names: Sequence[str]) -> dict[str, Any]:
    """Return to where four of five are read, by name."""
    places = [point['place'] for point in points]
    return {
        name: crossing(LEVEL, places, [point[name]['right'] for point in points]) for name in names
    }


@dataclass
class Sweep:
    """An experiment of some curves."""

    TITLE: str
    message: Callable[[dict[str, Any]], str]  # of the chart, by its figures
    axis: str
    curves: Sequence[Curve]
    claims: Callable[[dict[str, Any]], Claims]
    marks: Mapping[str, float] = field(default_factory=dict)  # the paper's own places, by curve

    def run(self, rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
        """Return shares of markers that are read, and to where four of five are, by curve."""
        seed, curves = int(rng.integers(2**31)), {}
        for curve in self.curves:
            places = curve.places[:: max(1, len(curve.places) // 3)] if quick else curve.places
            recordings = max(1, curve.recordings // 8) if quick else curve.recordings
            points = [_point(curve, place, recordings, seed) for place in places]
            curves[curve.name] = {'points': points, 'ends': ends_of(points, list(curve.variants))}
        return {'curves': curves}

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw a panel for each curve."""
        curves, count = figures['curves'].items(), len(figures['curves'])
        columns = 2 if count == 4 else min(3, count)
        height = (4.6 if count == 1 else 3.2) * -(-count // columns) + 1
        figure, panels = charts.new_chart(count, columns, height, self.message(figures))
        for axis, (name, curve) in zip(panels, curves, strict=True):
            charts.draw_reads(axis, curve['points'])
            if name in self.marks:
                axis.axvline(self.marks[name], **line(':'), linewidth=1.2)
            y = 'markers [%]' if axis in panels[::columns] else ''
            label(axis, self.axis, y, name, percent=True)
        charts.legend_below(figure, METHODS, WRONG | (_PAPERS_OWN if self.marks else {}))
        return figure


def end_of(figures: Mapping[str, Any], curve: str, method: str) -> float | None:
    """Return to where four of five are read."""
    at: float | None = figures['curves'][curve]['ends'][method]['at']
    return at


def lone_packets(range_m: float, seed: int, *, quick: bool) -> list[Sent]:
    """Return the lone packets that every experiment has at a distance."""
    rng = rng_at(seed, range_m)
    return [record_at(range_m, rng) for _ in range(1 if quick else LONE_RECORDINGS)]


def repeating(range_m: float, rng: np.random.Generator, *, size_m: float, packets: int) -> Sent:
    """Return markers that repeat, for a time of some packets."""
    return record_at(range_m, rng, size_m=size_m, repeated_s=packets * PACKET_S + LOOK_S)


def _aside(angle_deg: float, rng: np.random.Generator) -> Sent:
    """Return one marker at 1 m, at an angle from the axis, half-way between two rows of zones."""
    angle = math.radians(angle_deg)
    return record_at(1.0, rng, path=standing([math.sin(angle), 0.0, math.cos(angle)]))


def _like(
    places_m: Sequence[float], *, size_m: float = MARKER_SIZE_M, light: float = 0.0
) -> tuple[float, ...]:
    """Return where a marker stands out of noise as one of 3 cm does in the dark at some places."""
    dark = NOISE.floor + NOISE.slope * WALL_SIGNAL
    louder = (dark + NOISE.slope * light) / dark
    factor = (louder**0.25 * MARKER_SIZE_M / size_m) ** (2 / DISTANCE_EXPONENT)
    return tuple(round(factor * place, 3) for place in places_m)


def _several(size_cm: int, packets: int) -> Curve:
    size_m = size_cm / 100
    make = partial(repeating, size_m=size_m, packets=packets)
    variants = {method: {'method': method, 'max_packets': packets} for method in METHODS}
    places_m = _like(_OF_SEVERAL_M, size_m=size_m)
    return Curve(f'{size_cm} cm, {packets} packets', make, places_m, 3, variants, lone=False)


SMALL_M = _like(_LIKE_M, size_m=0.01)
"""Distances of lone packets of 1 cm, of which there are `SMALL_RECORDINGS` at each."""
SMALL_RECORDINGS = 4


class Reading(Sweep):
    """Distance, and how many of the bits that were read rightly had been wrong."""

    def draw(self, figures: dict[str, Any]) -> Any:
        """Draw shares over distance, and the wrong bits of both methods."""
        figure, (read, *bits) = charts.new_chart(3, 3, 4.4, self.message(figures))
        (points,) = (curve['points'] for curve in figures['curves'].values())
        charts.draw_reads(read, points)
        places = [point['place'] for point in points]
        found = [100 * point['paper']['found'] for point in points]
        read.plot(places, found, **line('-.', '0.3'), linewidth=1)
        read.axvline(PAPER_REACH_M, **line(':'))
        label(read, 'distance [m]', 'lone packets [%]', 'identified', percent=True)
        names = [*map(str, range(_MAX_BITS)), f'{_MAX_BITS} or more']
        for axis, method in zip(bits, METHODS, strict=True):
            trials = [point[method]['right']['trials'] for point in points]
            heights = 100 * np.array([point[method]['bits'] for point in points]).T / trials
            tops = heights.cumsum(axis=0)
            for height, top, name, colour in zip(heights, tops, names, charts.SHADES, strict=True):
                axis.bar(range(len(places)), height, 0.8, top - height, color=colour, label=name)
            label(axis, 'distance [m]', '', f'read, {charts.WORDS[method]}', percent=True)
            shown = range(0, len(places), 3)
            axis.set_xticks(shown, [f'{places[index]:g}' for index in shown])
            axis.grid(axis='x', visible=False)
        close = {'handlelength': 1, 'labelspacing': 0.2, 'borderaxespad': 0}
        how = {'loc': 'upper right', 'fontsize': 9, 'frameon': False} | close
        bits[-1].legend(title='wrong bits', **how)
        others = {'its preamble found': line('-.', '0.3'), "the paper's reach": line(':')}
        charts.legend_below(figure, METHODS, WRONG | others)
        return figure


def _read_to(figures: dict[str, Any], curve: str, unit: str = 'm') -> str:
    """Return to where the default reads, as text."""
    return as_text(end_of(figures, curve, 'joint'), unit, 2 if unit == 'm' else 0)


def _reaches(figures: dict[str, Any], curve: str, unit: str = 'm') -> Claim:
    """Return to where both methods read."""
    ends, digits = figures['curves'][curve]['ends'], 2 if unit == 'm' else 1
    return Claim(*(end_as_text(ends[method], f'[{unit}]', digits) for method in BOTH_CLAIMED))


def _reading_claims(figures: dict[str, Any]) -> Claims:
    def at(place: float, key: str) -> list[Any]:
        point = nearest(figures['curves']['3 cm']['points'], 'place', place)
        return [point[method][key] for method in BOTH_CLAIMED]

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
    point = nearest(figures['curves']['3 cm, 3 packets']['points'], 'place', PAPER_FOUND_M)
    return {
        'small': _reaches(figures, '1 cm, one packet'),
        'three': shares(point[method]['right']['rate'] for method in BOTH_CLAIMED),
    }


def _ambient_claims(figures: dict[str, Any]) -> Claims:
    lost = []
    for method in BOTH_CLAIMED:
        dark, day = (end_of(figures, light, method) for light in ('dark', 'daylight in a room'))
        lost.append(None if dark is None or day is None else dark - day)
    return {'loss': Claim(*map(as_text, lost)), 'outdoors': _reaches(figures, 'shade outdoors')}


SWEEPS: dict[str, Sweep] = {
    'reading': Reading(
        'Reading over distance',
        lambda got: f'Lone packets of 3 cm are read to {_read_to(got, "3 cm")}',
        _DISTANCE,
        [Curve('3 cm', record_at, RANGES_M, LONE_RECORDINGS)],
        _reading_claims,
    ),
    'reach': Sweep(
        'Reach over several packets',
        lambda got: (
            f'Eight packets added up: 1 cm is read to {_read_to(got, "1 cm, 8 packets")} '
            f'instead of {_read_to(got, "1 cm, one packet")}'
        ),
        'distance [m]',
        [
            Curve('1 cm, one packet', partial(record_at, size_m=0.01), SMALL_M, SMALL_RECORDINGS),
            *(_several(size_cm, packets) for size_cm in (1, 3) for packets in (3, 8)),
        ],
        _reach_claims,
        {'1 cm, one packet': PAPER_SMALL_M},
    ),
    'angle': Sweep(
        'Angle from the axis',
        lambda got: f'Markers are read to {_read_to(got, "at 1 m", "°")} from the axis',
        'angle from the axis [°]',
        [Curve('at 1 m', _aside, (0, 6, 12, 18, 21, 22, 23, 24, 25, 26, 28), 32)],
        lambda got: {'angle': _reaches(got, 'at 1 m', '°')},
        {'at 1 m': PAPER_ANGLE_DEG},
    ),
    'ambient': Sweep(
        'Ambient light',
        lambda got: (
            f'3 cm are read to {_read_to(got, "dark")} in the dark, to '
            f'{_read_to(got, "daylight in a room")} by daylight, '
            f'to {_read_to(got, "shade outdoors")} in the shade outdoors'
        ),
        _DISTANCE,
        [
            Curve(name, partial(record_at, ambient=light), _like(_LIKE_M, light=light), 4)
            for name, light in LIGHTS.items()
        ],
        _ambient_claims,
    ),
}
