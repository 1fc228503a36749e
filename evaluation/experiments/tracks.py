# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks of markers that move: their errors at every frame."""

import itertools
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from evaluation.bench import following
from evaluation.bench.places import held, median_mm, place_error, rms, rms_mm
from evaluation.bench.recordings import record_at
from evaluation.bench.room_markers import MOTIONS
from evaluation.bench.room_tracks import RoomTracks, follow_room
from evaluation.bench.room_truth import COMPANY
from evaluation.experiments.moving import DURATION_S, RANGES_M, WAYS
from evaluation.peers.camera import Background
from evaluation.peers.visual_markers import APRILTAG, AprilTagReader, View, read_pictures
from evaluation.report.chart_style import label, legend_below, look, new_chart
from evaluation.report.claims import NOTHING, Table, as_text, percent
from retrolidar_ros.scene.reference import SENSOR

TITLE = 'Markers that are followed'
_SPEEDS_M_S = (0.0, 0.1, 0.3, 0.6)
_SETTLED_S = 1.0  # after a track began
_RUNS = 40
_TRIALS = 24  # of each end
_ROOMS, _QUICK_ROOMS = 150, 6
_PICTURES = 40
_APART_M = (0.0, 0.1, 0.3)  # of two in a zone, at the first range
_CURVES = {'packets': 'packets', 'tracks': 'all'}
_EXPOSURES_S = {'33 ms': 1 / 30, '4 ms': 1 / 250}  # of its pictures, thirty a second


def moving_errors(
    way: str, speed_m_s: float, range_m: float, rng: np.random.Generator
) -> dict[str, Any]:
    """Return errors of a marker's packets and tracks while it moves."""
    path = WAYS[way](speed_m_s, range_m, rng)
    sent = record_at(range_m, rng, path=path, repeated_s=DURATION_S)
    _, steps = following.play(sent.recording)

    def error(one: Any) -> Any:
        return place_error(one.place, path(np.array([1e-9 * one.stamp_ns]))[0])

    detections = [one for step in steps for one in step.detections if one.id == sent.ids[0]]
    own = [one for step in steps for one in step.tracks if one.id == sent.ids[0]]
    began_ns = min((one.stamp_ns for one in own), default=0)
    settled = [(one, error(one)) for one in own if one.stamp_ns - began_ns > 1e9 * _SETTLED_S]
    bright = [wrong.range_m for one, wrong in settled if one.last_ns == one.stamp_ns]
    frames = sum(1e-9 * (int(at) - began_ns) > _SETTLED_S for at in sent.recording.stamp_ns)
    return {
        'packets': [error(one).range_m for one in detections],
        'bright': bright,
        'all': [wrong.range_m for _, wrong in settled],
        'pull': [wrong.range_m / one.place.range_stddev_m for one, wrong in settled],
        'squared': [wrong.squared_distance for _, wrong in settled],
        'updates_hz': len(bright) / max(frames * SENSOR.period_s, 1e-9),
    }


def _sum(runs: Sequence[dict[str, Any]]) -> dict[str, Any]:
    names = ('packets', 'bright', 'all', 'pull', 'squared')
    joined = {name: [value for one in runs for value in one[name]] for name in names}
    return {
        **{f'{name}_mm': rms_mm(joined[name]) for name in names[:3]},
        'pull': rms(joined['pull']),
        'ellipsoid_holds': held(joined['squared']),
        'updates_hz': float(np.mean([one['updates_hz'] for one in runs])),
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return errors over speed for packets, tracks and a tag."""
    runs, trials = (1, 2) if quick else (_RUNS, _TRIALS)
    curves = []
    for way, range_m in itertools.product(WAYS, RANGES_M):
        points = [
            {'speed_m_s': at, **_sum([moving_errors(way, at, range_m, rng) for _ in range(runs)])}
            for at in _SPEEDS_M_S
        ]
        curves.append({'way': way, 'range_m': range_m, 'points': points})
    shared = []
    for begins, apart_m in itertools.product(following.SECONDS_S, _APART_M):
        how = (RANGES_M[0], apart_m, begins, DURATION_S, rng)
        two = [following.two_in_a_zone(*how) for _ in range(runs)]
        shared.append({'apart_m': apart_m, 'begins': begins, **following.shared_figures(two)})
    ends = []
    for name, range_m in itertools.product(following.ENDS, RANGES_M):
        times_s = [following.dropped_s(range_m, rng, end=name) for _ in range(trials)]
        known_s = [one for one in times_s if one is not None]
        median_s, p95_s = np.percentile(known_s, (50, 95)).tolist() if known_s else (None, None)
        ends.append({'end': name, 'range_m': range_m, 'median_s': median_s, 'p95_s': p95_s})
    seed = int(rng.integers(2**32))
    rooms = [follow_room(number, seed) for number in range(_QUICK_ROOMS if quick else _ROOMS)]
    background = Background(rng)
    read = partial(read_pictures, [AprilTagReader()], background, 5 if quick else _PICTURES, rng)
    seen = {
        words: [
            read(View(RANGES_M[0], speed_m_s=at, longest_s=longest_s))[APRILTAG]
            for at in _SPEEDS_M_S
        ]
        for words, longest_s in _EXPOSURES_S.items()
    }
    found = {'curves': curves, 'shared': shared, 'ends': ends}
    return found | {'rooms': _in_rooms(rooms), 'apriltag': seen}


def _in_rooms(rooms: Sequence[RoomTracks]) -> dict[str, Any]:
    """Return how markers are followed in random rooms, by motion and company."""
    cells = []
    for motion, company in itertools.product(MOTIONS, COMPANY):
        own = [
            one
            for room in rooms
            for one in room.markers
            if (one.motion, one.company) == (motion, company)
        ]
        off = [error for one in own for error in one.off]
        frames = sum(one.frames for one in own)
        found = {
            'frames': frames,
            'followed': len(off) / frames if frames else None,
            'median_mm': median_mm([error.range_m for error in off]),
            'ellipsoid_holds': held([error.squared_distance for error in off]),
        }
        cells.append({'motion': motion, 'company': company, **found})
    false = sum(room.false for room in rooms) / max(sum(room.places for room in rooms), 1)
    return {'rooms': len(rooms), 'cells': cells, 'false': false}


def _by_speed(figures: dict[str, Any], head: str, cell: Callable[[Any], str]) -> Table:
    """Return a cell of each way, distance and speed."""
    rows = [[head, *(f'{at:g} m/s' for at in _SPEEDS_M_S)]]
    for curve in figures['curves']:
        where = f'{curve["way"].removesuffix(" the view")} at {curve["range_m"]:g} m'
        rows.append([where, *map(cell, curve['points'])])
    return rows


def table(figures: dict[str, Any]) -> Table:
    """Return errors of range by way, distance and speed, and those of tags."""
    names = ('packets_mm', 'all_mm', 'bright_mm')

    def in_mm(one: dict[str, Any]) -> str:
        return '/'.join(NOTHING if one[name] is None else f'{one[name]:.1f}' for name in names)

    rows = _by_speed(figures, 'error [mm]: packets/tracks/tracks with light', in_mm)
    for words, tags in _tags_mm(figures).items():
        cells = [as_text(one, '', 1) for one in tags]
        rows.append([f'AprilTag across at {RANGES_M[0]:g} m, exposure {words}', *cells])
    return rows


def _tags_mm(figures: dict[str, Any]) -> dict[str, list[float | None]]:
    """Return errors of tags over the speed, by exposure."""
    return {
        words: [one['error_mm'] and one['error_mm']['rms'] for one in seen]
        for words, seen in figures['apriltag'].items()
    }


def honest_table(figures: dict[str, Any]) -> Table:
    """Return errors of tracks over their estimates, and how often they are updated."""

    def known(one: dict[str, Any]) -> str:
        pull = NOTHING if one['pull'] is None else f'{one["pull"]:.2f}'
        return f'{pull}/{percent(one["ellipsoid_holds"])}/{one["updates_hz"]:.0f}'

    return _by_speed(figures, 'pull/in 95 % ellipsoid/updates [Hz]', known)


def shared_table(figures: dict[str, Any]) -> Table:
    """Return errors of two markers in a zone, and how often their tracks end."""
    head = ['two in a zone, the second', 'farther [m]', 'median error [mm]', 'rms [mm]']
    rows = [[*head, 'both followed', 'ends/h']]
    for one in figures['shared']:
        errors = (as_text(one[name], '', 1) for name in ('median_mm', 'rms_mm'))
        both = NOTHING if one['both_followed'] is None else f'{one["both_followed"]:.0%}'
        ends = as_text(one['ends_an_hour'], '', 0)
        rows.append([one['begins'], f'{one["apart_m"]:g}', *errors, both, ends])
    return rows


def ends_table(figures: dict[str, Any]) -> Table:
    """Return how long markers are followed after they ended."""
    rows = [['followed on [s], median/95 %', *(f'at {at:g} m' for at in RANGES_M)]]
    for name in following.ENDS:
        own = [one for one in figures['ends'] if one['end'] == name]
        times = ('/'.join(as_text(one[of], '') for of in ('median_s', 'p95_s')) for one in own)
        rows.append([f'a marker that {name}', *times])
    return rows


def rooms_table(figures: dict[str, Any]) -> Table:
    """Return how markers are followed in random rooms, and the share of false tracks."""
    rows = [['followed / median error [mm] / in 95 % ellipsoid', *COMPANY]]
    for motion in MOTIONS:
        own = [one for one in figures['rooms']['cells'] if one['motion'] == motion]
        cells = [
            f'{as_text(one["followed"] and 100 * one["followed"], "%", 0)}'
            f'/{as_text(one["median_mm"], "", 1)}/{percent(one["ellipsoid_holds"])}'
            for one in own
        ]
        rows.append([motion, *cells])
    false = f'{figures["rooms"]["false"]:.1%} of all places'
    return [*rows, ['false tracks', false, *[''] * (len(COMPANY) - 1)]]


def points_at(figures: dict[str, Any], way: str) -> list[dict[str, Any]]:
    """Return the points of one way at the first distance."""
    found: dict[str, Any] = next(one for one in figures['curves'] if one['way'] == way)
    return list(found['points'])


def _message(figures: dict[str, Any]) -> str:
    points = [one for curve in figures['curves'] for one in curve['points']]
    still, moving = (
        [one for one in points if bool(one['speed_m_s']) == of] for of in (False, True)
    )

    def better(own: list[dict[str, Any]]) -> str:
        count = sum((one['all_mm'] or np.inf) < (one['packets_mm'] or np.inf) for one in own)
        return f'{count} of {len(own)}'

    return (
        f'The range of a track, at any time, is better than that of a packet, at its stamp, '
        f'in {better(still)} cases at rest and {better(moving)} in motion'
    )


def draw(figures: dict[str, Any]) -> Any:
    """Draw the error of range over the speed at the first distance, a panel for each way."""
    figure, panels = new_chart(2, 2, 4.6, _message(figures))
    tags = {f'tag, exposed for {words}': errors for words, errors in _tags_mm(figures).items()}
    looks = {'packets': look('joint'), 'tracks': look('tracks')}
    for words, style in zip(tags, '-:', strict=True):
        looks[words] = look(APRILTAG) | {'linestyle': style}
    for axis, way in zip(panels, WAYS, strict=True):
        points = points_at(figures, way)
        curves = {name: [one[f'{key}_mm'] for one in points] for name, key in _CURVES.items()}
        for words, errors in (curves | (tags if axis is panels[0] else {})).items():
            axis.plot(_SPEEDS_M_S, errors, **looks[words])
        x, y, title = 'speed [m/s]', 'rms error of range [mm]', f'{way} at {RANGES_M[0]:g} m'
        label(axis, x, y, title, yscale='log', ylim=(0.2, 100), yticks=(0.3, 1, 3, 10, 30, 100))
    legend_below(figure, (), looks)
    return figure
