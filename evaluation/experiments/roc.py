# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What identification costs in false IDs: every method at every strictness of its knob."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.detectors import knob, new_detector
from evaluation.bench.false_ids import false_ids, wall_blocks
from evaluation.bench.link import Trial, link_scene, lone_trial, outcome
from evaluation.bench.rates import rate
from evaluation.bench.restless import restless_blocks
from evaluation.report.charts import look, new_chart, shared_legend
from evaluation.report.claims import NOTHING, Claim
from retrolidar_ros.detector import METHODS
from retrolidar_ros.detector.budget import USUAL_FALSE_IDS_PER_HOUR
from retrolidar_ros.detector.paper import LIKELIHOOD_THRESHOLD
from retrolidar_ros.scene.marker_budget import SNR
from retrolidar_ros.scene.reference import SENSOR

TITLE = 'Identification against false IDs'
SOURCE = ''

SHIPPED = {'paper': LIKELIHOOD_THRESHOLD, 'joint': USUAL_FALSE_IDS_PER_HOUR}
"""Values of the knobs that methods have unless told otherwise."""
_SNRS_DB = (6.0, 8.0, 10.0)
_SCENES, _QUICK_SCENES = 4, 1
# Sensor-hours from the laxest to the strictest: what is lax errs often enough in a short time.
_HOURS = {
    'wall': (0.02, 0.05, 0.1, 0.1, 0.1),
    'restless': (0.01, 0.02, 0.02, 0.02, 0.02),
}
_QUICK_HOURS = 0.001
_STREAMS = {'wall': wall_blocks, 'restless': restless_blocks}
_TITLES = {'wall': 'false IDs of a bare wall', 'restless': 'false IDs of moving hands'}


def _link(method: str, strictness: float, snr_db: float, trials: list[Trial]) -> dict[str, Any]:
    """Return how many markers a method reads right, and how many wrong."""
    right = wrong = 0
    for trial in trials:
        result = outcome(trial, new_detector(method, SENSOR.grid, strictness=strictness))
        right += np.count_nonzero(result.right)
        wrong += np.count_nonzero(result.wrong)
    zones = len(trials) * SENSOR.grid.zones
    return {'snr_db': snr_db, 'identified': rate(right, zones), 'wrong': rate(wrong, zones)}


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return identification of lone packets and false IDs an hour over the methods' knobs."""
    scenes = _QUICK_SCENES if quick else _SCENES
    trials = {
        snr_db: [lone_trial(link_scene(snr_db, rng), rng) for _ in range(scenes)]
        for snr_db in _SNRS_DB
    }
    seed = int(rng.integers(2**32))
    methods = {}
    steps = sum(len(knob(method)[1]) for method in METHODS)
    with tqdm(total=steps, desc='roc', leave=False) as progress:
        for method in METHODS:
            name, values = knob(method)
            points = []
            for index, strictness in enumerate(values):
                links = [_link(method, strictness, *of_link) for of_link in trials.items()]
                point: dict[str, Any] = {'strictness': strictness, 'links': links}
                for stream, blocks in _STREAMS.items():
                    hours = _QUICK_HOURS if quick else _HOURS[stream][index]
                    # The same noise for every method.
                    noise = np.random.default_rng(seed)
                    detector = new_detector(method, SENSOR.grid, strictness=strictness)
                    point[stream] = false_ids(detector, blocks(hours * 3600, noise), hours)
                points.append(point)
                progress.update()
            methods[method] = {'knob': name, 'points': points}
    return {'snrs_db': list(_SNRS_DB), 'methods': methods}


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    header = ''.join(f'  read at {snr_db:g} dB' for snr_db in figures['snrs_db'])
    lines = [f'method  knob                      {header}   false IDs/h: wall   restless']
    for method, result in figures['methods'].items():
        for point in result['points']:
            shares = ''.join(f'{link["identified"]["rate"]:14.1%}' for link in point['links'])
            wall, restless = (
                f'{point[stream]["per_hour"]:.4g}'
                if point[stream]['events']
                else f'<{point[stream]["high"]:.3g}'
                for stream in _STREAMS
            )
            lines.append(
                f'{method:6}  {result["knob"]:20} {point["strictness"]:5g}{shares}'
                f'{wall:>20}{restless:>11}'
            )
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set what both methods read and misread, as shipped, side by side."""
    shipped = {
        method: next(
            point
            for point in figures['methods'][method]['points']
            if point['strictness'] == SHIPPED[method]
        )
        for method in ('paper', 'joint')
    }
    claims = [
        Claim(
            f'one packet identified at {link["snr_db"]:g} dB',
            NOTHING,
            *(f'{point["links"][index]["identified"]["rate"]:.0%}' for point in shipped.values()),
        )
        for index, link in enumerate(shipped['paper']['links'])
    ]
    claims += [
        Claim(
            f'{_TITLES[stream]}, an hour',
            'none seen of silent markers' if stream == 'wall' else NOTHING,
            *(
                f'{point[stream]["per_hour"]:.0f} ({point[stream]["low"]:.0f} to '
                f'{point[stream]["high"]:.0f})'
                for point in shipped.values()
            ),
        )
        for stream in _STREAMS
    ]
    return claims


def comment(figures: dict[str, Any]) -> str:
    """Say what the knobs do."""
    return (
        'Every method has a knob between too many readings and too few: `likelihood_threshold` of '
        '`paper`, `false_ids_per_hour` of `joint`. The table has them as shipped; the chart has '
        'all of them.'
    )


def _draw_stream(
    axis: Any, points: list[dict[str, Any]], column: int, stream: str, how: Any
) -> None:
    """Draw identification over the false IDs of one stream, with the confidence of both."""
    known = [point for point in points if point[stream]['events']]
    for point in points:
        false, share = point[stream], point['links'][column]['identified']
        percent = 100 * share['rate']
        if point in known:
            place = false['per_hour']
            axis.hlines(percent, false['low'], false['high'], colors=how['color'], alpha=0.4)
        else:
            place = false['high']
            axis.plot(place, percent, **how, markerfacecolor='white')
            axis.annotate(
                '',
                (place / 2.5, percent),
                (place, percent),
                arrowprops={'arrowstyle': '->', 'color': how['color']},
            )
        axis.vlines(place, 100 * share['low'], 100 * share['high'], colors=how['color'], alpha=0.4)
    axis.plot(
        [point[stream]['per_hour'] for point in known],
        [100 * point['links'][column]['identified']['rate'] for point in known],
        **how,
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over false IDs an hour: a row a stream, a column a link."""
    snrs_db = figures['snrs_db']
    figure, axes = new_chart(len(_STREAMS), len(snrs_db), 16, 10)
    for row, stream in zip(axes, _STREAMS, strict=True):
        for column, (axis, snr_db) in enumerate(zip(row, snrs_db, strict=True)):
            for method, result in figures['methods'].items():
                _draw_stream(axis, result['points'], column, stream, look(method))
            axis.set_xscale('log')
            axis.set_xlim(1, 1e5)
            axis.set_ylim(-2, 102)
            axis.set_title(f'{SNR} = {snr_db:g} dB; {_TITLES[stream]}', fontsize=11)
            axis.set_xlabel('false IDs an hour', fontsize=10)
        row[0].set_ylabel('one packet identified [%]', fontsize=10)
    shared_legend(
        figure,
        'Identification against false IDs, each method from lax to strict; bars: 95 % confidence',
        [
            (
                'none seen: at the upper bound',
                {'marker': 'o', 'color': '0.2', 'markerfacecolor': 'white', 'linestyle': ''},
            )
        ],
    )
    figure.savefig(path)
