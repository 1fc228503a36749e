# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Brighter is surer: lone packets of dim to bright markers, under one stress after the other."""

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from evaluation.bench.judging import Read, judge_all, read_of
from evaluation.bench.rates import Rate, chance_of_fall, sum_of
from evaluation.bench.recordings import record, snr_db
from evaluation.bench.stresses import STRESSES, Stress
from evaluation.report.chart_style import label, new_chart
from evaluation.report.claims import Table
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene.marker_budget import SNR

TITLE = 'Brighter is surer'
SIGNALS = (10.0, 15.0, 40.0, 150.0, 600.0)  # of the bright markers, without the wall [kcps/SPAD]
FALL_CHANCE = 0.01
"""A share that falls with a smaller chance than this, over all pairs of signals, is reported."""
_POSSIBLE_DB = 8.0  # below this c over sigma a lone packet is not to be asked for


def cell(
    stress: Stress, signal: float, recordings: int, rng: np.random.Generator
) -> dict[str, Read]:
    """Return what both methods read under a stress at a signal."""
    found = judge_all(lambda rng: record(stress, signal, rng), recordings, rng)
    return {method: read_of(rows) for method, rows in found.items()}


def fall(rates: Sequence[Rate]) -> float:
    """Return the chance of the least likely fall from a signal to a brighter one, 0 to 1."""
    pairs = list(itertools.combinations(rates, 2))
    return min(1.0, len(pairs) * min((chance_of_fall(*pair) for pair in pairs), default=1.0))


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return what is read, by stress and signal."""
    rows = []
    for stress in STRESSES[:: 4 if quick else 1]:
        cells = [cell(stress, signal, 1 if quick else 2, rng) for signal in SIGNALS]
        row: dict[str, Any] = {method: [one[method] for one in cells] for method in METHODS}
        falls = {method: fall([one[method]['right'] for one in cells]) for method in METHODS}
        snrs_db = [snr_db(signal, stress.noise) for signal in SIGNALS]
        rows.append({'stress': stress.name, 'snr_db': snrs_db, **row, 'fall': falls})
    return {'signals': list(SIGNALS), 'rows': rows}


def table(figures: dict[str, Any]) -> Table:
    """Return how many stresses there are under which a brighter marker is read less."""
    rows: dict[str, list[str]] = {'': list(METHODS)}
    rows['stresses under which brighter is significantly less read'] = [
        ', '.join(row['stress'] for row in figures['rows'] if row['fall'][method] < FALL_CHANCE)
        or 'none'
        for method in METHODS
    ]
    for signal in (40.0, 150.0, 600.0):
        place = figures['signals'].index(signal)
        rows[f'least share read at {signal:g} kcps/SPAD'] = [
            f'{min(row[method][place]["right"]["rate"] for row in figures["rows"]):.0%}'
            for method in METHODS
        ]
    wrong = [[one['wrong'] for row in figures['rows'] for one in row[name]] for name in METHODS]
    rows['markers of which a wrong ID was read'] = [f'{sum_of(one)["rate"]:.1%}' for one in wrong]
    return [[what, *cells] for what, cells in rows.items()]


def _message(figures: dict[str, Any]) -> str:
    falls = [row['stress'] for row in figures['rows'] if row['fall']['joint'] < FALL_CHANCE]
    worse = ', '.join(falls) or 'no stress'
    return f'Under {worse} a brighter marker is read significantly less than a faint one'


def draw(figures: dict[str, Any]) -> Any:
    """Draw shares read as colours, stresses over signals, for both methods."""
    figure, panels = new_chart(2, 1, 9, _message(figures))
    names = [row['stress'] for row in figures['rows']]
    for axis, method in zip(panels, METHODS, strict=True):
        shares = np.array(
            [[100 * one['right']['rate'] for one in row[method]] for row in figures['rows']]
        )
        image = axis.imshow(shares, cmap='viridis', vmin=0, vmax=100, aspect='auto')
        for (row, column), share in np.ndenumerate(shares):
            weak = figures['rows'][row]['snr_db'][column] < _POSSIBLE_DB
            words, colour = f'{share:.0f}', 'black' if share > 55 else 'white'
            centred = {'ha': 'center', 'va': 'center', 'fontsize': 10, 'color': colour}
            axis.text(column, row, f'({words})' if weak else words, **centred)
        title = 'default' if method == 'joint' else "the paper's method"
        label(axis, 'signal of the bright marker [kcps/SPAD]', '', title)
        axis.set_yticks(range(len(names)), names)
        axis.tick_params(axis='y', labelsize=9)
        axis.set_xticks(range(len(SIGNALS)), [f'{signal:g}' for signal in figures['signals']])
        axis.grid(visible=False)
    figure.colorbar(image, ax=panels, label='lone packets read [%]', shrink=0.6)
    limit = f'{SNR} below {_POSSIBLE_DB:g} dB, where a lone packet is not to be asked for'
    figure.supxlabel(f'in brackets: {limit}', fontsize=11)
    return figure
