# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Three markers at once (paper §6.2, Tab. 3), and two in one zone, which the paper leaves out."""

from dataclasses import replace
from typing import Any

import numpy as np

from evaluation.bench.judging import read_by_both
from evaluation.bench.rates import rate
from evaluation.bench.recordings import record_at
from evaluation.bench.stresses import PLAIN
from evaluation.report import chart_style as charts
from evaluation.report.chart_style import label, line, look
from evaluation.report.claims import BOTH_CLAIMED, Claims, shares
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Surface
from retrolidar_ros.scene.reference import RESPONSE, SENSOR, WALL_SIGNAL

TITLE = 'Several markers'
PAPER_WORST = 0.85  # of Tab. 3
ARRANGEMENTS = {
    'far apart': ((1.0, -14, -8), (1.5, 12, 7), (2.0, 7, -14)),
    'one height': ((1.0, -17, 6), (1.5, -6, 6), (2.0, 17, 6)),
    'neighbours': ((1.2, -6, -6), (1.5, 6, -6), (1.8, 6, 6)),
    'on borders': ((1.0, -12, 6), (1.5, 0, -6), (2.0, 12, 6)),
    'bright beside faint': ((1.0, 6, 6), (2.0, 18, 6), (2.0, 6, -6)),
}  # where the markers are: range [m], angles to the right and down [°]
SHARES = (1.0, 0.7, 0.5, 0.35, 0.25, 0.15, 0.1)
"""Signal of the fainter marker of two in one zone over that of the brighter."""
WATCHED_S = 8.0
_PAIR = {'brighter': '-', 'both': '--'}
_WAKING_S = (2.0, 2.5)
_QUICK_TRIALS = 4
_RECORDINGS = 2
_SENSOR = replace(SENSOR, blur=0.05)
_WALL = Surface(2.4, WALL_SIGNAL)


def three_markers(arrangement: str, rng: np.random.Generator) -> Scene:
    """Return three markers with random IDs that wake for one packet each, about the same time."""
    ranges_m, *angles_deg = np.array(ARRANGEMENTS[arrangement]).T
    rays = np.column_stack([*np.tan(np.radians(angles_deg)), np.ones(3)])
    places_m = (ranges_m / np.linalg.norm(rays, axis=1))[:, None] * rays
    ids = rng.choice(USABLE_IDS, 3, replace=False).tolist()
    starts_s = rng.uniform(*_WAKING_S, 3).tolist()
    markers = tuple(
        Marker(id_, tuple(place_m), f'{id_}', start_s=start_s, packets=1, response=RESPONSE)
        for id_, place_m, start_s in zip(ids, places_m.tolist(), starts_s, strict=True)
    )
    return Scene(sensor=_SENSOR, markers=markers, surfaces=(_WALL,))


def _three(arrangement: str, trials: int, rng: np.random.Generator) -> dict[str, Any]:
    """Count how often each of three markers is read."""
    counts = {method: np.zeros(3, dtype=int) for method in METHODS}
    for _ in range(trials):
        scene = three_markers(arrangement, rng)
        sent = [marker.id for marker in scene.markers]
        for method, found in read_by_both(Simulation(scene, rng).run(4.4)).items():
            ids = {one.id for one in found}
            counts[method] += [one in ids for one in sent]
    read = {of: {'read': [rate(n, trials) for n in own.tolist()]} for of, own in counts.items()}
    return {'arrangement': arrangement, **read}


def _pairs(share: float, rng: np.random.Generator) -> dict[str, Any]:
    """Count how often both of two markers in a zone are read in a time: a pair in each zone."""
    counts = {method: np.zeros(len(_PAIR), dtype=int) for method in METHODS}
    pairs = 0
    for _ in range(_RECORDINGS):
        sent = record_at(1.3, rng, replace(PLAIN, second=share), repeated_s=WATCHED_S)
        assert sent.seconds is not None
        pairs += len(sent.ids)
        for method, found in read_by_both(sent.recording).items():
            read = {(zone, one.id) for one in found for zone in one.zones}
            first, second = (
                np.array([pair in read for pair in enumerate(ids.tolist())])
                for ids in (sent.ids, sent.seconds)
            )
            counts[method] += [first.sum(), (first & second).sum()]
    rows = {
        method: {name: rate(n, pairs) for name, n in zip(_PAIR, row.tolist(), strict=True)}
        for method, row in counts.items()
    }
    return {'share': share, **rows}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return how often each of three markers is read from one packet, and of two in one zone."""
    trials, stride = (_QUICK_TRIALS, 3) if quick else (60, 1)
    return {
        'three': [_three(one, trials, rng) for one in ARRANGEMENTS],
        'two': [_pairs(share, rng) for share in SHARES[::stride]],
    }


def claims(figures: dict[str, Any]) -> Claims:
    """Return the rates, to compare with the paper's."""
    read = [
        [one['rate'] for row in figures['three'] for one in row[method]['read']]
        for method in BOTH_CLAIMED
    ]
    return {'mean': shares(map(np.mean, read), 1), 'worst': shares(map(min, read))}


def draw(figures: dict[str, Any]) -> Any:
    """Draw the rates of the arrangements, and of two in a zone over their ratio."""
    three = min(one['rate'] for row in figures['three'] for one in row['joint']['read'])
    two = [row['joint']['both']['rate'] for row in figures['two']]
    pair = f'both of two in one zone in {min(two):.0%} to {max(two):.0%}'
    title = f'Each of three markers is read in {three:.0%} of the trials, {pair}'
    figure, (three, two) = charts.new_chart(2, 2, 4.8, title)
    for offset, method in zip((-0.14, 0.14), METHODS, strict=True):
        how = look(method) | {'linestyle': '', 'markersize': 8}
        for index, row in enumerate(figures['three']):
            places = index + offset + np.linspace(-0.08, 0.08, 3)
            three.plot(places, [100 * one['rate'] for one in row[method]['read']], **how)
    charts.draw_level(three, 100 * PAPER_WORST, "the paper's worst", 0.7, linestyle='-.')
    names = [row['arrangement'].replace(' ', '\n', 1) for row in figures['three']]
    title = 'three markers at 1 to 2 m, one packet'
    label(three, '', 'packets identified [%]', title, percent=True)
    three.set_xticks(range(len(names)), names, fontsize=9)
    ratios = [row['share'] for row in figures['two']]
    for method in METHODS:
        for name, style in _PAIR.items():
            rates = [row[method][name] for row in figures['two']]
            charts.draw_shares(two, ratios, rates, linestyle=style, **look(method))
    x = 'fainter signal over brighter one'
    y, title = f'read within {WATCHED_S:g} s [%]', 'two markers in one zone'
    label(two, x, y, title, percent=True, xscale='log', xticks=ratios)
    two.invert_xaxis()
    charts.legend_below(figure, METHODS, {name: line(style) for name, style in _PAIR.items()})
    return figure
