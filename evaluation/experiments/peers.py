# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""LiDAR markers beside AprilTags and QR codes of the same size, at the same places."""

import math
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from evaluation.bench.judging import judge_all, read_of
from evaluation.bench.rates import nearest
from evaluation.bench.recordings import Sent, record_at, rng_at
from evaluation.experiments import paper_sweeps
from evaluation.experiments.moving import across
from evaluation.experiments.paper_sweeps import ends_of
from evaluation.peers import visual_markers
from evaluation.peers.camera import Background
from evaluation.peers.visual_markers import APRILTAG, APRILTAG_FINE, QR, View
from evaluation.report.chart_style import draw_reads, label, legend_below, look, new_chart
from evaluation.report.claims import (
    BOTH_CLAIMED,
    NOTHING,
    Claim,
    Claims,
    Table,
    as_text,
    end_as_text,
    model,
)

TITLE = 'LiDAR markers beside visual ones'
AT_M = 1.0  # where everything but distance is swept: all read nearly everything there
_PICTURES, _QUICK_PICTURES = 32, 8
_NAMES = ['joint', 'paper', APRILTAG, APRILTAG_FINE, QR]

_1_CM_M = (0.3, 0.5, 0.7, 0.85, 0.95, 1.05, 1.15, *paper_sweeps.SMALL_M[1:])
_ANGLES_DEG = (0, 20, 40, 50, 58, 59, 60, 65, 70, 75, 80)
_SPEEDS_M_S = (0.0, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 0.8, 1.0, 1.2, 1.8)
_LUXES = (300.0, 30.0, 10.0, 3.0, 1.0, 0.3, 0.1)
_VEILS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2)

_small = partial(record_at, size_m=0.01)


def _yawed(yaw_deg: float, rng: np.random.Generator) -> Sent:
    return record_at(AT_M, rng, yaw_deg=yaw_deg)


def _moved(speed_m_s: float, rng: np.random.Generator) -> Sent:
    return record_at(AT_M, rng, path=across(speed_m_s, AT_M, rng))


Maker = Callable[[float, np.random.Generator], Sent]
# Recordings of lone packets; the same frames as where these are swept alone.
_COUNTS: dict[Maker, int] = {
    record_at: paper_sweeps.LONE_RECORDINGS,
    _small: paper_sweeps.SMALL_RECORDINGS,
    _moved: 32,
}
# Of each sweep: its axis, its places, what these are to the camera, and what the LiDAR sees.
_SWEEPS: dict[str, tuple[str, tuple[float, ...], str, Maker | None]] = {
    '3 cm': ('distance [m]', paper_sweeps.TAG_RANGES_M, 'range_m', record_at),
    '1 cm': ('distance [m]', _1_CM_M, 'range_m', _small),
    'yaw': ('yaw [°]', _ANGLES_DEG, 'yaw_deg', _yawed),
    # A retroreflector is the same about both axes.
    'pitch': ('pitch [°]', _ANGLES_DEG, 'pitch_deg', _yawed),
    'speed': ('speed across [m/s]', _SPEEDS_M_S, 'speed_m_s', _moved),
    'speed, 4 ms': ('speed across [m/s]', _SPEEDS_M_S, 'speed_m_s', None),
    'light': ('light on the marker [lux]', _LUXES, 'lux', None),
    'glare': ('veil of glare [of white]', _VEILS, 'veil', None),
}
_VIEWS = {'1 cm': {'size_m': 0.01}, 'speed, 4 ms': {'longest_s': 1 / 250}}


def _lidar(make: Maker, place: float, *, quick: bool, seed: int) -> dict[str, Any]:
    """Return what both methods make of lone packets, with their errors of range."""
    recordings = max(1, _COUNTS.get(make, 3) // (3 if quick else 1))
    at_m, results = place if make in (record_at, _small) else AT_M, {}
    found = judge_all(partial(make, place), recordings, rng_at(seed, place))
    for method, rows in found.items():
        off_m = [one.place.range_m - at_m for row in rows for one in row.own]
        # Of one that moves, the range is another one at each stamp.
        error_mm = None if make is _moved else visual_markers.errors(off_m)
        results[method] = {**read_of(rows), 'error_mm': error_mm}
    return results


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return readings and errors over distance, angle, speed, light and glare."""
    seed = int(rng.integers(2**31))
    readers, missing = visual_markers.find_readers()
    background = Background(rng)
    pictures, stride = (_QUICK_PICTURES, 5) if quick else (_PICTURES, 1)
    sweeps, read = {}, cache(partial(_lidar, quick=quick, seed=seed))
    for name, (axis, places, what, make) in _SWEEPS.items():
        places = places[::stride]
        if name == '3 cm':
            found = visual_markers.read_over_distance(readers, places, seed, quick=quick)
        else:
            usual = {'range_m': AT_M, **_VIEWS.get(name, {})}
            views = [View(**{**usual, what: place}) for place in places]
            read_all = partial(visual_markers.read_pictures, readers, background, pictures, rng)
            found = [read_all(view) for view in views]
        points = [
            {'place': place, **tags, **({} if make is None else read(make, place))}
            for place, tags in zip(places, found, strict=True)
        ]
        names = [one for one in _NAMES if one in points[0]]
        sweeps[name] = {'axis': axis, 'points': points, 'ends': ends_of(points, names)}
    return {'sweeps': sweeps, 'missing': missing}


def end(figures: dict[str, Any], sweep: str, name: str) -> float | None:
    """Return to where four of five are read."""
    ends = figures['sweeps'][sweep]['ends']
    return ends[name]['at'] if name in ends else None


def words(figures: dict[str, Any], sweep: str, name: str, digits: int = 2) -> str:
    """Return the same as text, with a sign where four of five are read at all places."""
    found = figures['sweeps'][sweep]
    if name not in found['ends']:
        return NOTHING
    first, last = (found['points'][index]['place'] for index in (0, -1))
    beyond = '≥ ' if last > first else '≤ '
    text = end_as_text(found['ends'][name], found['axis'], digits)
    return beyond + text if found['ends'][name]['at'] == last else text


def error(figures: dict[str, Any], name: str, range_m: float, which: str) -> float | None:
    """Return an error of range at 3 cm [mm]."""
    found = nearest(figures['sweeps']['3 cm']['points'], 'place', range_m).get(name)
    return None if found is None or found['error_mm'] is None else float(found['error_mm'][which])


_ROWS = {
    '3 cm': '3 cm, distance',
    '1 cm': '1 cm, distance',
    'yaw': 'yaw at 1 m',
    'pitch': 'pitch at 1 m',
    'speed': 'speed across at 1 m, exposure 33 ms',
    'speed, 4 ms': 'the same, exposure 4 ms',
    'light': 'the dark, 3 cm at 1 m',
    'glare': 'glare, 3 cm at 1 m',
}


def table(figures: dict[str, Any]) -> Table:
    """Return to where each reads, the rows first in which the AprilTag is better."""

    def lead(sweep: str) -> float:
        ours, _, *tags = (end(figures, sweep, name) or 0.0 for name in _NAMES)
        return max(tags) / ours if ours else 0.0

    rows = [
        ['80 % are read to', 'LiDAR, default', 'LiDAR, paper', *_NAMES[2:]],
        ['time to an answer', '1.3 s', '1.3 s', *['33 ms'] * 3],
        ['orientation', 'none', 'none', *['full'] * 3],
    ]
    for sweep in sorted(_ROWS, key=lead, reverse=True):
        digits = 0 if sweep in ('yaw', 'pitch') else 2
        cells = [words(figures, sweep, name, digits) for name in _NAMES]
        lit = ['own light'] * 2 if sweep == 'light' else cells[:2]
        rows.append([_ROWS[sweep], *lit, *cells[2:]])
    for range_m in (1.0, 2.0):
        cells = [as_text(error(figures, name, range_m, 'median'), 'mm', 1) for name in _NAMES]
        rows.append([f'median error of range, 3 cm at {range_m:g} m', *cells])
    return rows


def claims(figures: dict[str, Any]) -> Claims:
    """Return our values for what the paper says of both kinds of marker."""

    def more(value: float | None, than: float | None) -> str:
        return NOTHING if value is None or than is None else f'{value / than - 1:+.0%}'

    def of_tag(range_m: float, which: str) -> float | None:
        return error(figures, APRILTAG, range_m, which)

    small, far = end(figures, '1 cm', APRILTAG), of_tag(2.4, 'median')
    above = of_tag(2.0, 'above_1_cm')
    ours_m = [end(figures, size, 'joint') for size in ('1 cm', '3 cm')]
    medians = (error(figures, method, 2.4, 'median') for method in BOTH_CLAIMED)
    return {
        'tag-3': model(as_text(end(figures, '3 cm', APRILTAG))),
        'tag-1': model(as_text(small)),
        'gain': model(more(end(figures, '1 cm', 'joint'), small)),
        'near': model(as_text(of_tag(1.0, 'median'), 'mm', 1)),
        'far': model(as_text(far, 'mm', 1)),
        'worst': model(as_text(of_tag(2.4, 'largest'), 'mm', 1)),
        'above': model(as_text(above and 100 * above, '%', 1)),
        'less': Claim(*(more(one, far) for one in medians)),
        'power': model(_power(*ours_m)),
        'yaw': Claim(*(words(figures, 'yaw', method, 1) for method in BOTH_CLAIMED)),
        'qr': model(as_text(end(figures, '3 cm', QR))),
    }


def _power(small_m: float | None, large_m: float | None) -> str:
    """Return with which power of the area the reach grows from 1 to 3 cm."""
    return f'{math.log(large_m / small_m) / math.log(9):.2f}' if small_m and large_m else NOTHING


def _message(figures: dict[str, Any]) -> str:
    large, small = (
        [words(figures, size, name) for name in ('joint', APRILTAG)] for size in ('3 cm', '1 cm')
    )
    return (
        f'LiDAR markers of 3 cm are read to {large[0]}, AprilTags to {large[1]}; '
        f'of 1 cm, to {small[0]} and {small[1]}'
    )


_PANELS = {
    '3 cm': '3 cm',
    '1 cm': '1 cm',
    'error': 'ranges of 3 cm',
    'yaw': 'yaw at 1 m',
    'pitch': 'pitch at 1 m',
    'speed': 'speed at 1 m (dotted: 4 ms)',
    'light': 'the dark: LiDAR has its own light',
    'glare': 'glare, until paper is white',
}


def draw(figures: dict[str, Any]) -> Any:
    """Draw a panel for each sweep, and the error of range."""
    figure, panels = new_chart(8, 2, 12.5, _message(figures))
    for axis, (name, title) in zip(panels, _PANELS.items(), strict=True):
        if name == 'error':
            sweep = figures['sweeps']['3 cm']
            for reader in sweep['ends']:
                known = [point for point in sweep['points'] if point[reader]['error_mm']]
                medians = [point[reader]['error_mm']['median'] for point in known]
                axis.plot([point['place'] for point in known], medians, **look(reader))
            label(axis, 'distance [m]', 'median error of range [mm]', title, yscale='log')
            continue
        for key, style in ((name, '-'), (f'{name}, 4 ms', ':')):
            if key in figures['sweeps']:
                sweep = figures['sweeps'][key]
                draw_reads(axis, sweep['points'], sweep['ends'], wrong=False, linestyle=style)
        y = 'read in one packet or picture [%]' if axis in panels[::4] else ''
        label(axis, figures['sweeps'][name]['axis'], y, title, percent=True)
        if name == 'light':
            axis.set_xscale('log')
            axis.invert_xaxis()
    legend_below(figure, [name for name in _NAMES if name not in figures['missing']])
    return figure
