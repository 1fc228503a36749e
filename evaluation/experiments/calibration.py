# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibration: recordings of emulated sensors that it has not seen, truth beside estimate."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from evaluation.bench.calibration_trials import KINDS, kind_trial, room, sweep_trial, trial
from evaluation.report.charts import label, legend_under, look, new_chart
from evaluation.report.claims import Table
from retrolidar_ros.sensor.frame import Floats

TITLE = 'Calibration from a recording'
MESSAGE = 'What a calibration says of its own errors holds'
_TRIALS, _QUICK_TRIALS = 16, 2
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


def table(figures: dict[str, Any]) -> Table:
    """Return the largest error of everything, and how often the intervals hold the truth."""
    trials = figures['trials']
    within = f'within {RISE_MS:g} ms / at best / or twice the bound'
    rows = [['', 'estimates', 'largest error', 'held by 95 %', within, 'bound, median and largest']]

    def add(what: str, errors: Floats, *bound: str) -> NDArray[np.bool_]:
        held: NDArray[np.bool_] = np.abs(errors[:, 0]) < 1.96 * errors[:, 1]
        worst = f'{np.abs(errors[:, 0]).max():.4g}'
        rows.append([what, str(len(errors)), worst, f'{held.mean():.0%}', *(bound or ('', ''))])
        return held

    inside = np.concatenate([add(name, errors) for name, errors in _errors(figures).items()])
    for scale in dict.fromkeys(one['scale'] for one in trials):
        alike = [one for one in trials if one['scale'] == scale and 'rise [ms]' in one['errors']]
        errors = np.array([one['errors']['rise [ms]'] for one in alike])
        bound_ms = np.array([one['rise bound [ms]'] for one in alike])
        off_ms = np.abs(errors[:, 0])
        shares = (
            off_ms < RISE_MS,
            [math.erf(RISE_MS / one / math.sqrt(2)) for one in bound_ms],
            off_ms < np.maximum(RISE_MS, 2 * bound_ms),
        )
        words = ' / '.join(f'{np.mean(share):.0%}' for share in shares)
        bounds = f'{np.median(bound_ms):.2g} ms, {bound_ms.max():.2g} ms'
        add(f'rise [ms], noise {scale:g} times the usual', errors, words, bounds)
    law = f'{100 * max(one["noise"] for one in trials):.1f} %'
    others = [
        ['noise law', str(len(trials)), law, ''],
        ['all', str(len(inside)), '', f'{100 * np.mean(inside):.1f} %'],
    ]
    kinds = {kind: [one for one in figures['kinds'] if one['kind'] == kind] for kind in KINDS}
    for what, recordings in {'as above': trials, **kinds}.items():
        after = [one['read after'] for one in recordings if one['read before'] < FEW]
        missed = f'{100 * (1 - np.mean(after or [1.0])):.1f} %'
        others.append([f'packets not read: {what}', str(len(after)), missed, ''])
    return [*rows, *([*cells, '', ''] for cells in others)]


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
