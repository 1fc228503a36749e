# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Errors of range: of markers that blink, of silent ones, and of a bare board."""

import math
from typing import Any

import numpy as np

from evaluation.bench.following import walls
from evaluation.bench.judging import BOTH, judged
from evaluation.bench.rates import nearest
from evaluation.bench.recordings import signal_at
from evaluation.experiments.paper_sweeps import lone_packets
from evaluation.report.chart_style import OTHERS, label, legend_below, line, look, new_chart
from evaluation.report.claims import BOTH_CLAIMED, Claim, Claims, as_text, model
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.optics import DISTANCE_EXPONENT
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats

TITLE = 'Ranging'
PAPER_MEDIAN_MM = 2.0
_RANGES_M = (1.0, 1.4, 1.8, 2.0, 2.2, 2.4, 2.6)
_PACKET_FRAMES = 62
_GRID = SENSOR.grid
_KINDS = {
    'joint': 'blinking, default',
    'paper': 'blinking, method paper',
    'silent': 'silent',
    'board': 'bare board',
}
_LOOKS = {'silent': {'color': '0.4', 'marker': 's'}, 'board': {'color': OTHERS[1], 'marker': '^'}}


def board_signal(range_m: float) -> float:
    """Return what a bare board of 9 cm² sends back [kcps/SPAD]: 4 at 1.4 m (paper §3.2)."""
    return float(4.0 * (range_m / 1.4) ** DISTANCE_EXPONENT)


def mean_errors_m(signal: float, range_m: float, rng: np.random.Generator) -> Floats:
    """Return errors of a packet's length of distances, averaged, of a signal in every zone [m]."""
    scene = Scene(sensor=SENSOR, surfaces=walls(range_m, _GRID, signal))
    distance = Simulation(scene, rng).advance(_PACKET_FRAMES).distance.astype(np.float64)
    errors: Floats = (distance / _GRID.z_per_range).mean(axis=0) - range_m
    return errors


def _summed(errors_m: list[float]) -> dict[str, Any]:
    sizes = 1e3 * np.abs(errors_m)
    median, p95 = np.quantile(sizes, (0.5, 0.95)).tolist() if len(sizes) else (None, None)
    return {'median_mm': median, 'p95_mm': p95}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return errors of ranges over distance: read by both methods, silent, and of a board."""
    seed, points = int(rng.integers(2**31)), []
    for range_m in _RANGES_M[:: 3 if quick else 1]:
        errors: dict[str, list[float]] = {kind: [] for kind in _KINDS}
        for sent in lone_packets(range_m, seed, quick=quick):
            for method in METHODS:
                own = judged(sent, BOTH[method]).own
                errors[method] += [one.place.range_m - range_m for one in own]
        # A marker that is silent is bright.
        signals = {'silent': WALL_SIGNAL + signal_at(range_m), 'board': board_signal(range_m)}
        for kind, signal in signals.items():
            errors[kind] += mean_errors_m(signal, range_m, rng).tolist()
        sizes = {kind: _summed(found) for kind, found in errors.items()}
        points.append({'range_m': range_m, **sizes})
    return {'points': points}


def claims(figures: dict[str, Any]) -> Claims:
    """Return the errors, to compare with the paper's."""

    def at(range_m: float, kind: str) -> float:
        point = nearest(figures['points'], 'range_m', range_m)
        return float(point[kind]['median_mm'] or math.inf)

    places = [one['range_m'] for one in figures['points'][:-1]]
    below = [max(at(place, kind) for place in places) for kind in BOTH_CLAIMED]
    return {
        'near': Claim(*(as_text(one, 'mm', 1) for one in below)),
        'far': Claim(*(as_text(at(2.6, kind), 'mm', 1) for kind in BOTH_CLAIMED)),
        'board': model(as_text(at(2.0, 'board'), 'mm', 1)),
    }


def draw(figures: dict[str, Any]) -> Any:
    """Draw median and 95 % errors over distance."""
    ends = near, far = figures['points'][0], figures['points'][-1]
    ours, papers = (
        [as_text(point[kind]['median_mm'], 'mm', 1) for point in ends] for kind in METHODS
    )
    title = (
        f'Ranges are {ours[0]} off at {near["range_m"]:g} m and {ours[1]} at '
        f"{far['range_m']:g} m; by the paper's method, {papers[0]} and {papers[1]}"
    )
    figure, (axis,) = new_chart(1, 1, 5, title)
    places = [one['range_m'] for one in figures['points']]
    for kind in _KINDS:
        how = _LOOKS.get(kind) or look(kind)
        for key, style in (('median_mm', '-'), ('p95_mm', ':')):
            axis.plot(places, [one[kind][key] for one in figures['points']], style, **how)
    axis.axhline(PAPER_MEDIAN_MM, **line('-.'), linewidth=1)
    label(axis, 'distance of a marker of 3 cm [m]', 'error of range [mm]', yscale='log')
    axis.yaxis.set_major_formatter('{x:g}')
    others = {
        'silent, averaged': _LOOKS['silent'],
        'bare board': _LOOKS['board'],
        'median': line('-'),
        '95 %': line(':'),
        "the paper's bound of the median": line('-.'),
    }
    legend_below(figure, METHODS, others)
    return figure
