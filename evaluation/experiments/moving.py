# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A marker that moves: how many of its packets are read, and how many wrong IDs."""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from evaluation.bench.judging import BOTH, judged
from evaluation.bench.rates import frequency, rate
from evaluation.bench.recordings import Path, record_at, to_and_fro
from evaluation.report.chart_style import draw_shares, label, legend_below, line, look, new_chart
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Floats

TITLE = 'Markers that move'
RANGES_M = (1.0, 2.0)
DURATION_S = 20.0
_SPEEDS_M_S = (0.0, 0.05, 0.1, 0.2, 0.3, 0.4, 0.6, 0.8)
_INNER = 0.85  # the marker turns round at this share of the view's half
_ALONG_M = 0.3  # how far one that comes and goes does


def across(speed_m_s: float, range_m: float, rng: np.random.Generator) -> Path:
    """Return the way of a marker through the view at a speed, at a distance [m]."""
    half_m = _INNER * range_m * SENSOR.grid.view / 2
    begin_m, down_m = rng.uniform(0, 4 * half_m), rng.uniform(-half_m, half_m)

    def path(time_s: Floats) -> Floats:
        x = to_and_fro(begin_m + speed_m_s * time_s, half_m)
        return np.column_stack([x, np.full(len(x), down_m), np.full(len(x), range_m)])

    return path


def along(speed_m_s: float, range_m: float, rng: np.random.Generator) -> Path:
    """Return the way of a marker that comes nearer and goes away."""
    begin_m = rng.uniform(0, 4 * _ALONG_M)
    half = 0.5 * _INNER * SENSOR.grid.view / 2
    tangents = rng.uniform(-half, half, 2)

    def path(time_s: Floats) -> Floats:
        z = range_m + to_and_fro(begin_m + speed_m_s * time_s, _ALONG_M)
        return np.column_stack([z * tangents[0], z * tangents[1], z])

    return path


Way = Callable[[float, float, np.random.Generator], Path]
WAYS: dict[str, Way] = {'across the view': across, 'to and fro': along}


def _followed(
    way: Way, speed_m_s: float, range_m: float, runs: int, rng: np.random.Generator
) -> dict[str, Any]:
    """Return what both methods read of a marker that repeats while it moves."""
    packets, hours = 0, runs * DURATION_S / 3600
    wrong = dict.fromkeys(METHODS, 0)
    read = dict.fromkeys(METHODS, 0)
    for _ in range(runs):
        path = way(speed_m_s, range_m, rng)
        sent = record_at(range_m, rng, path=path, repeated_s=DURATION_S)
        # The first packet began before the first frame, and the last may be read after its end.
        whole = range(1, math.floor((DURATION_S - sent.start_s[0]) / sent.packet_s) - 1)
        packets += len(whole)
        for method in METHODS:
            found = judged(sent, BOTH[method], lone=False)
            wrong[method] += found.readings - len(found.own)
            middles_s = [
                1e-9 * one.start_ns + (one.packets - 0.5) * sent.packet_s - sent.start_s[0]
                for one in found.own
            ]
            read[method] += len({math.floor(one / sent.packet_s) for one in middles_s} & {*whole})
    return {
        method: {'read': rate(read[method], packets), 'wrong': frequency(wrong[method], hours)}
        for method in METHODS
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return shares of packets read and wrong IDs, by way, distance and speed."""
    speeds, runs = ((0.0, 0.2), 1) if quick else (_SPEEDS_M_S, 8)
    curves = []
    for (name, way), range_m in itertools.product(WAYS.items(), RANGES_M):
        points = [{'speed_m_s': at, **_followed(way, at, range_m, runs, rng)} for at in speeds]
        curves.append({'way': name, 'range_m': range_m, 'points': points})
    return {'curves': curves}


def _message(figures: dict[str, Any]) -> str:
    points = [curve['points'][-1] for curve in figures['curves']]
    rates = [[one[method]['read']['rate'] for one in points] for method in METHODS]
    ours = f'{min(rates[0]):.0%} of the packets or more are read'
    paper = f"by the paper's method {min(rates[1]):.0%} to {max(rates[1]):.0%}"
    return f'Markers that move at {points[0]["speed_m_s"]:g} m/s: {ours}, {paper}'


def draw(figures: dict[str, Any]) -> Any:
    """Draw packets read and wrong IDs over the speed, a column for each way."""
    figure, panels = new_chart(4, 2, 7, _message(figures))
    styles = dict(zip(RANGES_M, ('-', ':'), strict=True))
    for curve in figures['curves']:
        column = list(WAYS).index(curve['way'])
        speeds = [point['speed_m_s'] for point in curve['points']]
        for method in METHODS:
            rates = [point[method]['read'] for point in curve['points']]
            how = look(method) | {'linestyle': styles[curve['range_m']]}
            draw_shares(panels[column], speeds, rates, **how)
            wrong = [point[method]['wrong']['per_hour'] for point in curve['points']]
            panels[2 + column].plot(speeds, wrong, **how)
    for column, way in enumerate(WAYS):
        label(panels[column], '', 'packets read [%]', way, percent=True)
        axis = panels[2 + column]
        label(axis, 'speed [m/s]', 'wrong IDs an hour', yscale='symlog', ylim=(-0.5, None))
    legend_below(figure, METHODS, {f'at {at:g} m': line(style) for at, style in styles.items()})
    return figure
