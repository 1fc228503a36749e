# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What identification costs in false IDs: every method at every strictness of its knob.

False IDs are counted before every member of the family of scenes without a marker
(`evaluation.bench.disturbances`), and before markers that are silent.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.disturbances import FAMILY, White, source_blocks
from evaluation.bench.judging import Options, judged, new_detector, read_of
from evaluation.bench.rates import frequency, rate
from evaluation.bench.recordings import record, signal_at
from evaluation.bench.stresses import PLAIN
from evaluation.report.charts import legend_below, look, new_chart
from evaluation.report.claims import Claim, Claims, Table, claim_of, per_hour
from retrolidar_ros.detector import METHODS
from retrolidar_ros.detector.budget import USUAL_FALSE_IDS_PER_HOUR
from retrolidar_ros.detector.paper import LIKELIHOOD_THRESHOLD
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.scene.truth import PACKET_S
from retrolidar_ros.sensor.frame import Recording

TITLE = 'Identification against false IDs'
MESSAGE = "The default reads more than the paper's method at any rate of false IDs"
KNOBS = {
    'joint': ('false_ids_per_hour', (1e4, 1e3, 1e2, 10.0, 1.0, USUAL_FALSE_IDS_PER_HOUR)),
    'paper': ('likelihood_threshold', (0.05, 0.1, 0.2, 0.3, LIKELIHOOD_THRESHOLD, 0.5, 0.8)),
}
"""The knob of each method, from lax to strict."""
SHIPPED = {'joint': USUAL_FALSE_IDS_PER_HOUR, 'paper': LIKELIHOOD_THRESHOLD}
GROUPS = {
    'bare wall': ('white',),
    'signals that walk': tuple(one.name for one in FAMILY if 'walk' in one.name),
    'what comes and goes, hands': ('come and go', 'come together', 'hands'),
    'what blinks, and is no marker': ('random bits', 'random levels'),
}
"""Members of the family by the panel that shows them."""
_RANGES_M = (2.6, 2.9)
_RECORDINGS, _QUICK_RECORDINGS = 6, 1
# Sensor-hours before each member: what is lax errs often enough in a short time.
_LEAST_H, _SHIPPED_H, _QUIET_H = 0.003, 0.08, 1.0
_BLINKING_H = 0.01
_QUICK_SHARE = 0.05
_PREAMBLES = 'false preambles'
_SILENT = partial(source_blocks, partial(White, signals=(30.0, 30.0)))


def _hours(member: str, method: str, value: float) -> float:
    """Return for how long a member is watched."""
    if member == 'white' and value != SHIPPED['joint']:
        return _SHIPPED_H
    if method == 'paper':
        return 3 * _LEAST_H
    if member.startswith('random'):
        return _BLINKING_H if value == SHIPPED[method] else _LEAST_H / 2
    if value != SHIPPED[method]:
        return _LEAST_H * (1 + 2 * KNOBS[method][1].index(value))
    return _QUIET_H if member == 'white' else _SHIPPED_H


def watch(options: Options, blocks: Iterable[Recording], hours: float) -> dict[str, Any]:
    """Play a stream without marker, which lasts some hours, and count what is read."""
    detector = new_detector(SENSOR.grid, options)
    events = sum(len(detector.update_all(block)) for block in blocks)
    return {'false_ids': frequency(events, hours), 'candidates': detector.counts.candidates}


def _point(method: str, value: float, seed: int, share: float) -> dict[str, Any]:
    """Return the false IDs of one setting of a knob, by member."""
    options = {'method': method, KNOBS[method][0]: value}
    members = {}
    for index, member in enumerate(FAMILY):
        hours = share * _hours(member.name, method, value)
        # The same noise for every method and setting.
        blocks = member.blocks(3600 * hours, np.random.default_rng([seed, index]), SENSOR)
        members[member.name] = watch(options, blocks, hours)
    return {'knob': value, 'members': members}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return identification of lone packets and false IDs an hour over the methods' knobs."""
    share = _QUICK_SHARE if quick else 1.0
    recordings = _QUICK_RECORDINGS if quick else _RECORDINGS
    sent = {
        range_m: [record(PLAIN, signal_at(range_m), rng, USABLE_IDS) for _ in range(recordings)]
        for range_m in _RANGES_M
    }
    seed = int(rng.integers(2**32))
    methods = {}
    for method in METHODS:
        name, values = KNOBS[method]
        points = []
        for value in tqdm(values[:: 3 if quick else 1], desc=f'roc {method}', leave=False):
            options = {'method': method, name: value}
            point = _point(method, value, seed, share)
            point['read'] = {
                f'{range_m:g}': read_of([judged(one, options) for one in rows])
                for range_m, rows in sent.items()
            }
            points.append(point)
        if points[-1]['knob'] != SHIPPED[method] and quick:
            points.append(points[-1] | {'knob': SHIPPED[method]})
        methods[method] = {'knob': name, 'points': points}
    return {'methods': methods, 'silent': _silent(seed, share)}


def _silent(seed: int, share: float) -> dict[str, Any]:
    """Return what is read of markers that do not send: a wall that is as bright as they are."""
    hours = 0.3 * share
    looks = max(1, round(hours * 3600 / PACKET_S)) * SENSOR.grid.zones
    found: dict[str, Any] = {'hours': hours}
    for method in METHODS:
        rng = np.random.default_rng(seed)
        found[method] = watch({'method': method}, _SILENT(3600 * hours, rng), hours)
        candidates = min(found[method]['candidates'], looks)
        found[method][_PREAMBLES] = rate(candidates, looks)
    return found


def shipped(figures: dict[str, Any], method: str) -> dict[str, Any]:
    """Return the point of a method as shipped."""
    points: list[dict[str, Any]] = figures['methods'][method]['points']
    return next(point for point in points if point['knob'] == SHIPPED[method])


def grouped(point: dict[str, Any], group: str) -> Any:
    """Return the false IDs before the members of a group."""
    found = [point['members'][name]['false_ids'] for name in GROUPS[group]]
    return frequency(sum(one['events'] for one in found), sum(one['hours'] for one in found))


def table(figures: dict[str, Any]) -> Table:
    """Return false IDs an hour as shipped, by member, with their exact 95 % confidence."""
    rows = [['false IDs an hour (95 %), as shipped', *METHODS, 'hours watched by joint']]
    points = [shipped(figures, method) for method in METHODS]
    for member in FAMILY:
        found = [point['members'][member.name]['false_ids'] for point in points]
        rows.append([member.name, *map(per_hour, found), f'{found[0]["hours"]:.2g}'])
    still = [grouped(points[0], group) for group in list(GROUPS)[:3]]
    total = frequency(sum(one['events'] for one in still), sum(one['hours'] for one in still))
    other = [grouped(points[1], group) for group in list(GROUPS)[:3]]
    paper = frequency(sum(one['events'] for one in other), sum(one['hours'] for one in other))
    rows.append(
        ['all that do not blink', per_hour(total), per_hour(paper), f'{total["hours"]:.2g}']
    )
    return rows


def claims(figures: dict[str, Any]) -> Claims:
    """Set false preambles and false IDs beside the paper's."""
    silent = figures['silent']
    words = [
        f'{silent[method]["false_ids"]["events"]} in {silent["hours"]:.2g} h'
        for method in reversed(METHODS)
    ]
    preambles = silent['paper'][_PREAMBLES]['rate']
    wall = [grouped(shipped(figures, method), 'bare wall') for method in reversed(METHODS)]
    return {
        'silent': claim_of(words, silent['joint']['false_ids']['events'] == 0),
        'preambles': Claim(f'{preambles:.2%}', agrees=preambles <= 0.005),
        'wall': claim_of(map(per_hour, wall)),
    }


def _draw_group(axis: Any, figures: dict[str, Any], group: str) -> None:
    """Draw identification over the false IDs of a group, with the confidence of both."""
    for method, style in zip(METHODS, ('-', '-'), strict=True):
        points = figures['methods'][method]['points']
        for range_m, face in zip(_RANGES_M, (None, 'white'), strict=True):
            how = look(method) | ({} if face is None else {'markerfacecolor': face})
            found = [grouped(point, group) for point in points]
            shares = [100 * point['read'][f'{range_m:g}']['right']['rate'] for point in points]
            # Where nothing was read, all that is known is the upper bound.
            places = [one['per_hour'] or one['high'] for one in found]
            axis.plot(places, shares, linestyle=style, **how)
            for one, place, share, point in zip(found, places, shares, points, strict=True):
                low = one['low'] or place / 4
                axis.plot([low, one['high']], [share, share], color=how['color'], alpha=0.35)
                if not one['events']:
                    axis.plot(place / 4, share, '<', color=how['color'], markersize=5, alpha=0.6)
                if point['knob'] == SHIPPED[method]:
                    axis.plot(place, share, 'o', markersize=13, color='0.1', fillstyle='none')


def draw(figures: dict[str, Any]) -> Any:
    """Draw identification over false IDs, a panel for each kind of scene."""
    figure, axes = new_chart(2, 2, 14, 10.5, MESSAGE)
    for axis, group in zip(axes.flat, GROUPS, strict=True):
        _draw_group(axis, figures, group)
        axis.set_xscale('log')
        axis.set_ylim(-2, 102)
        axis.set_title(group, fontsize=13)
        axis.set_xlabel('false IDs an hour, 16 zones')
        axis.set_ylabel('lone packets identified [%]')
    others: dict[str, Any] = {
        f'at {_RANGES_M[0]:g} m': {'color': '0.2', 'marker': 'o'},
        f'at {_RANGES_M[1]:g} m': {'color': '0.2', 'marker': 'o', 'markerfacecolor': 'white'},
        'as shipped': {
            'color': '0.1',
            'marker': 'o',
            'fillstyle': 'none',
            'markersize': 13,
            'linestyle': '',
        },
        'none seen: upper bound': {'color': '0.4', 'marker': '<', 'linestyle': '-'},
    }
    legend_below(figure, METHODS, others)
    return figure
