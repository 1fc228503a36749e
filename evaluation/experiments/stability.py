# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each method bears: one stress after the other, from harmless to failure."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.detectors import new_detector
from evaluation.bench.link import RANGE_M, outcome
from evaluation.bench.rates import Rate, falls_below, rate
from evaluation.bench.stress import HAND_DISTANCE_M, HAND_SIGNAL
from evaluation.report.charts import LEVEL, draw_shares, look, new_chart, shared_legend
from evaluation.report.claims import NOTHING, Claim
from evaluation.report.panels import FAR_WALL_M, PANELS, SNR_DB, Panel
from retrolidar_ros.detector import METHODS
from retrolidar_ros.scene.marker_budget import SNR
from retrolidar_ros.scene.reference import WALL_SIGNAL

TITLE = 'Where methods fail'
SOURCE = ''

_TRIALS = 32
_QUICK_TRIALS = 16
_QUICK_STRIDE = 4
_COLUMNS = 4


def breaking_points(panel: Panel, places: list[float], rates: list[Rate]) -> dict[str, Any]:
    """Return where identification falls below 80 %, on either side of the harmless value.

    Parameters
    ----------
    panel : Panel
        The stress.
    places : list of float
        Its values, all on the way from one end to the other.
    rates : list of Rate
        Identification at each.

    Returns
    -------
    dict
        'holds': whether the harmless value itself is borne; 'below' and 'above': the breaking
        points, None where there is none.
    """
    ordered = sorted(zip(places, (row['rate'] for row in rates), strict=True))
    downward = [(x, share) for x, share in reversed(ordered) if x <= panel.harmless]
    upward = [(x, share) for x, share in ordered if x >= panel.harmless]
    below, above = (
        falls_below(LEVEL, [x for x, _ in way], [share for _, share in way])
        for way in (downward, upward)
    )
    return {'holds': upward[0][1] >= LEVEL, 'below': below, 'above': above}


def _sweep(
    panel: Panel,
    values: list[float],
    trials: int,
    rng: np.random.Generator,
    progress: Any,
) -> dict[str, Any]:
    """Give every method the same recordings at every value of a stress."""
    scenes = math.ceil(trials / panel.grid.zones)
    counts = np.zeros((len(values), len(METHODS), 2), dtype=int)
    for row, value in enumerate(values):
        for _ in range(scenes):
            trial = panel.trial(value, rng)
            for column, method in enumerate(METHODS):
                detector = new_detector(method, panel.grid, bit_period_s=panel.bit_period_s)
                counts[row, column] += np.count_nonzero(outcome(trial, detector), axis=-1)
        progress.update()
    zones = scenes * panel.grid.zones
    results = {}
    for column, method in enumerate(METHODS):
        right = [rate(int(hits), zones) for hits in counts[:, column, 0]]
        results[method] = {
            'identified': right,
            'wrong': [rate(int(hits), zones) for hits in counts[:, column, 1]],
            'breaks': breaking_points(panel, values, right),
        }
    return {
        'name': panel.name,
        'title': panel.title,
        'axis': panel.axis,
        'harmless': panel.harmless,
        'bit_period_s': panel.bit_period_s,
        'zones': panel.grid.zones,
        'values': values,
        'methods': results,
    }


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return identification and wrong-ID rates of lone packets under every stress."""
    stride, trials = (_QUICK_STRIDE, _QUICK_TRIALS) if quick else (1, _TRIALS)
    sweeps = [(panel, list(panel.values[::stride])) for panel in PANELS]
    points = sum(len(values) for _, values in sweeps)
    with tqdm(total=points, desc='stability', leave=False) as progress:
        panels = [_sweep(panel, values, trials, rng, progress) for panel, values in sweeps]
    return {
        'snr_db': SNR_DB,
        'marker_m': RANGE_M,
        'wall_signal': WALL_SIGNAL,
        'hand_signal': HAND_SIGNAL,
        'hand_m': HAND_DISTANCE_M,
        'far_wall_m': FAR_WALL_M,
        'level': LEVEL,
        'panels': panels,
    }


def _told(breaks: dict[str, Any]) -> str:
    """Return breaking points as text."""
    if not breaks['holds']:
        return 'always'
    found = [f'{breaks[side]:.3g}' for side in ('below', 'above') if breaks[side] is not None]
    return ' and '.join(found) or 'never'


def _most_wrong(rates: list[Rate]) -> str:
    """Return the largest rate, as text."""
    return f'{max(row["rate"] for row in rates):.1%}'


def summarise(figures: dict[str, Any]) -> str:
    """Return where each method breaks, and the most wrong IDs on the way there and beyond."""
    width = max(len(f'{panel["title"]}, {panel["axis"]}') for panel in figures['panels'])
    methods = list(figures['panels'][0]['methods'])
    lines = [
        f'{"identification below 80 %: where (most wrong IDs)":{width}}'
        + ''.join(f'{method:>30}' for method in methods)
    ]
    for panel in figures['panels']:
        cells = (
            f'{_told(result["breaks"])} ({_most_wrong(result["wrong"])})'
            for result in panel['methods'].values()
        )
        title = f'{panel["title"]}, {panel["axis"]}'
        lines.append(f'{title:{width}}' + ''.join(f'{cell:>30}' for cell in cells))
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set where both methods break under each stress side by side."""
    return [
        Claim(
            f'{panel["title"]}: below {figures["level"]:.0%} from, {panel["axis"]}',
            NOTHING,
            *(_told(panel['methods'][method]['breaks']) for method in ('paper', METHODS[0])),
        )
        for panel in figures['panels']
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say how to read the table."""
    wrong = {
        method: max(
            row['rate'] for panel in figures['panels'] for row in panel['methods'][method]['wrong']
        )
        for method in figures['panels'][0]['methods']
    }
    shares = ', '.join(f'`{method}` {share:.1%}' for method, share in wrong.items())
    return (
        'Each stress grows from harmless until nothing is read; "always" means that the method '
        f'reads less than {figures["level"]:.0%} even where the stress is harmless, "never" that '
        'it bears the most of it. The largest share of wrong IDs in any of these: '
        f'{shares}. The paper sweeps none of these but distance; its drone has motion and '
        'occlusion in one trial.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw a panel for every stress."""
    rows = math.ceil(len(figures['panels']) / _COLUMNS)
    figure, axes = new_chart(rows, _COLUMNS, 16, 12)
    for index, (axis, panel) in enumerate(zip(axes.flat, figures['panels'], strict=True)):
        axis.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
        for method, result in panel['methods'].items():
            how = look(method)
            draw_shares(axis, panel['values'], result['identified'], **how)
            wrong = [100 * row['rate'] for row in result['wrong']]
            axis.plot(panel['values'], wrong, **{**how, 'markersize': 2}, linestyle='--')
            broken = [result['breaks'][side] for side in ('below', 'above')]
            for place in broken:
                if place is not None:
                    axis.axvline(place, color=how['color'], linewidth=1, linestyle=':')
        if panel['harmless'] == max(panel['values']):
            axis.invert_xaxis()
        axis.set_ylim(-2, 102)
        axis.set_title(f'{index + 1}  {panel["title"]}', fontsize=11)
        axis.set_xlabel(panel['axis'], fontsize=10)
        if index % _COLUMNS == 0:
            axis.set_ylabel('markers [%]', fontsize=10)
    shared_legend(
        figure,
        f'One packet a marker, {SNR} = {figures["snr_db"]:g} dB where it is not swept',
        [
            ('right ID, 95 % confidence', {'color': '0.2'}),
            ('wrong ID', {'color': '0.2', 'linestyle': '--'}),
            ('identification falls below 80 %', {'color': '0.2', 'linestyle': ':'}),
        ],
    )
    figure.savefig(path)
