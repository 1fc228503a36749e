# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibration: recordings of emulated sensors that it has not seen, truth beside estimate."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from evaluation.bench.calibration_trials import KINDS, kind_trial, room, sweep_trial, trial
from evaluation.report.charts import label, legend_under, look, new_chart
from evaluation.report.claims import NOTHING, Table
from retrolidar_ros.sensor.frame import Floats

TITLE = 'Calibration from a recording'
MESSAGE = 'What a calibration says of its own errors holds'
_TRIALS, _QUICK_TRIALS = 20, 2
SCALES = (0.25, 1.0, 4.0, 8.0)
SENSORS = ((1 / 60, 4), (0.021, 4), (1 / 30, 4), (1 / 15, 8))  # frame period [s], and rows of zones
KIND_SCALE = 4.0  # scale of the noise, of other kinds of recordings
RISE_MS = 1.0  # how well the time in which a crystal brightens is to be found, where that can be
FEW = 0.5  # of the packets, below which a recording counts as not read


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return all trials, by the scale of the noise and the sensor."""
    count = _QUICK_TRIALS if quick else _TRIALS
    sensors = [SENSORS[index % len(SENSORS)] for index in range(count)]
    trials = [
        {'scale': scale, **trial(room(rng, period_s, rows, scale))}
        for scale in SCALES
        for period_s, rows in sensors
    ]
    sweeps = [sweep_trial(rng, SENSORS[index % 3][0]) for index in range(count)]
    kinds = [
        kind_trial(kind, room(rng, period_s, rows, KIND_SCALE))
        for kind in list(KINDS)[:: 3 if quick else 1]
        for period_s, rows in SENSORS[: 1 if quick else None]
    ]
    return {'trials': trials, 'sweeps': sweeps, 'kinds': kinds}


def _errors(figures: dict[str, Any]) -> dict[str, Floats]:
    """Return errors and deviations of every quantity, shape (trials, 2)."""
    names = dict.fromkeys(name for one in figures['trials'] for name in one['errors'])
    errors = {
        name: np.array([one['errors'][name] for one in figures['trials'] if name in one['errors']])
        for name in names
    }
    errors['blur'] = np.array([one for one in figures['sweeps'] if one])
    return errors


def _reading(trials: list[dict[str, Any]]) -> tuple[int, float]:
    """Return how many recordings the defaults read in under half, and what is read of them then."""
    unread = [one['read after'] for one in trials if one['read before'] < FEW]
    return len(unread), float(np.mean(unread)) if unread else 1.0


def table(figures: dict[str, Any]) -> Table:
    """Return the largest error of everything, and how often the intervals hold the truth."""
    trials = figures['trials']
    heads = ['', 'estimates', 'largest error', 'held by 95 %']
    within = f'within {RISE_MS:g} ms'
    bound = [f'{within} / at best / or twice the bound', 'bound, median and largest']
    rows = [[*heads, *bound]]
    inside: list[bool] = []
    for name, errors in _errors(figures).items():
        held = np.abs(errors[:, 0]) < 1.96 * errors[:, 1]
        inside += held.tolist()
        worst = float(np.abs(errors[:, 0]).max())
        cells = [name, str(len(errors)), f'{worst:.4g}', f'{held.mean():.0%}']
        rows.append([*cells, *[''] * len(bound)])
    for scale in dict.fromkeys(one['scale'] for one in trials):
        found = np.array(
            [
                (*one['errors']['rise [ms]'], one['rise bound [ms]'])
                for one in trials
                if one['scale'] == scale and 'rise [ms]' in one['errors']
            ]
        )
        off = np.abs(found[:, 0])
        cells = [
            f'rise [ms], noise {scale:g} times the usual',
            str(len(found)),
            f'{off.max():.4g}',
            f'{np.mean(off < 1.96 * found[:, 1]):.0%}',
            ' / '.join(
                f'{np.mean(share):.0%}'
                for share in (
                    off < RISE_MS,
                    [math.erf(RISE_MS / one / math.sqrt(2)) for one in found[:, 2]],
                    off < np.maximum(RISE_MS, 2 * found[:, 2]),
                )
            ),
            f'{np.median(found[:, 2]):.2g} ms, {found[:, 2].max():.2g} ms',
        ]
        rows.append(cells)
    law = max(one['noise'] for one in trials)
    others = [
        ['noise law', str(len(trials)), f'{100 * law:.1f} %'],
        ['all', str(len(inside)), NOTHING, f'{100 * np.mean(inside):.1f} %'],
    ]
    kinds = [[one for one in figures['kinds'] if one['kind'] == kind] for kind in KINDS]
    for what, of in (('as above', trials), *zip(KINDS, kinds, strict=True)):
        unread, read = _reading(of)
        words = f'packets not read: {what}'
        others.append([words, str(unread), f'{100 * (1 - read):.1f} %'])
    rows += [[*cells, *[''] * (len(rows[0]) - len(cells))] for cells in others]
    return rows


def draw(figures: dict[str, Any]) -> Any:
    """Draw errors against what they claim to be, quantity by quantity."""
    errors = _errors(figures)
    figure, (axis,) = new_chart(1, 1, 9.0, 5, MESSAGE)
    for index, one in enumerate(errors.values()):
        scores = one[:, 0] / np.maximum(one[:, 1], 1e-12)
        across = index + 0.6 * (np.arange(len(scores)) / max(len(scores), 1) - 0.5)
        axis.plot(across, np.clip(scores, -5, 5), '.', color=look('joint')['color'], markersize=4)
    axis.axhspan(-1.96, 1.96, color='0.9', zorder=0, label='95 of 100 are to be here')
    label(axis, '', 'error / its standard deviation')
    axis.set_xticks(range(len(errors)), [name.split(' [')[0] for name in errors])
    legend_under(axis)
    return figure
