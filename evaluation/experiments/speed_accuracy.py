# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What each method costs in computing time, and what it gives for it."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.detectors import new_detector
from evaluation.bench.false_ids import false_ids, wall_blocks
from evaluation.bench.link import link_scene, lone_trial, outcome
from evaluation.bench.rates import Rate, falls_below, rate
from evaluation.bench.sweep import told
from evaluation.report.charts import LEVEL, look, new_chart, shared_legend
from evaluation.report.claims import NOTHING, Claim
from evaluation.report.panels import SLOW_BIT_PERIOD_S, SLOW_SENSOR, SNR_DB
from retrolidar_ros.detector import METHODS
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import Sensor
from retrolidar_ros.scene.marker_budget import SNR
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.sensor.frame import Recording

TITLE = 'Computing time against accuracy'
SOURCE = ''

# Sensor and bit period, by number of zones: as fast as the sensor goes with them.
_MODES = {16: (SENSOR, BIT_PERIOD_S), 64: (SLOW_SENSOR, SLOW_BIT_PERIOD_S)}
_SNRS_DB = (20.0, 18.0, 16.0, 14.0, 12.0, 10.0, 8.0, 6.0, 4.0, 2.0, 0.0)
_QUICK_SNRS_DB = (14.0, 2.0)
_TRIALS, _QUICK_TRIALS = 64, 16
_HOURS = {16: 0.15, 64: 0.25}
_QUICK_HOURS = 0.002
_FRAMES, _QUICK_FRAMES = 500, 150
_REPEATS = 3
_TALKING = 3


def _frame_us(method: str, recording: Recording, bit_period_s: float) -> float:
    """Return the median processor time of a frame [µs], the best of a few plays."""
    medians = []
    for _ in range(_REPEATS):
        detector = new_detector(method, recording.grid, bit_period_s=bit_period_s)
        spent_ns = np.zeros(len(recording))
        for index, frame in enumerate(recording):
            began_ns = time.process_time_ns()
            detector.update(frame)
            spent_ns[index] = time.process_time_ns() - began_ns
        medians.append(float(np.median(spent_ns)))
    return min(medians) / 1000


def _streams(
    sensor: Sensor, bit_period_s: float, frames: int, rng: np.random.Generator
) -> dict[str, Recording]:
    """Return recordings with three markers talking and with none."""
    scene = link_scene(SNR_DB, rng, packets=None, sensor=sensor, bit_period_s=bit_period_s)
    talking = replace(scene, markers=scene.markers[:_TALKING])
    quiet = replace(scene, markers=())
    return {
        'talking': Simulation(talking, rng).advance(frames),
        'quiet': Simulation(quiet, rng).advance(frames),
    }


def _identified(
    snr_db: float, sensor: Sensor, bit_period_s: float, trials: int, rng: np.random.Generator
) -> dict[str, Rate]:
    """Return how many lone packets each method reads right."""
    right = dict.fromkeys(METHODS, 0)
    zones = sensor.grid.zones
    scenes = -(-trials // zones)
    for _ in range(scenes):
        scene = link_scene(snr_db, rng, sensor=sensor, bit_period_s=bit_period_s)
        trial = lone_trial(scene, rng)
        for method in METHODS:
            detector = new_detector(method, sensor.grid, bit_period_s=bit_period_s)
            right[method] += np.count_nonzero(outcome(trial, detector).right)
    return {method: rate(hits, scenes * zones) for method, hits in right.items()}


def _needed_db(snrs_db: tuple[float, ...], rates: list[Rate]) -> float | None:
    """Return the weakest link that suffices, of those from strong to weak; None = none does."""
    shares = [row['rate'] for row in rates]
    if min(shares) >= LEVEL:
        return snrs_db[-1]
    return falls_below(LEVEL, snrs_db, shares)


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return processor time a frame, link needed and false IDs of every method and grid."""
    snrs_db = _QUICK_SNRS_DB if quick else _SNRS_DB
    seed = int(rng.integers(2**32))
    rows = []
    steps = len(_MODES) * (len(snrs_db) + 2 * len(METHODS))
    with tqdm(total=steps, desc='speed-accuracy', leave=False) as progress:
        for zones, (sensor, bit_period_s) in _MODES.items():
            links = []
            for snr_db in snrs_db:
                trials = _QUICK_TRIALS if quick else _TRIALS
                links.append(_identified(snr_db, sensor, bit_period_s, trials, rng))
                progress.update()
            streams = _streams(sensor, bit_period_s, _QUICK_FRAMES if quick else _FRAMES, rng)
            hours = _QUICK_HOURS if quick else _HOURS[zones]
            for method in METHODS:
                frame_us = {
                    name: _frame_us(method, recording, bit_period_s)
                    for name, recording in streams.items()
                }
                progress.update()
                shares = [link[method] for link in links]
                noise = np.random.default_rng(seed)  # the same for every method
                detector = new_detector(method, sensor.grid, bit_period_s=bit_period_s)
                rows.append(
                    {
                        'method': method,
                        'zones': zones,
                        'frame_us': frame_us,
                        'identified': shares,
                        'needed_db': _needed_db(snrs_db, shares),
                        'false_ids': false_ids(
                            detector, wall_blocks(hours * 3600, noise, sensor), hours
                        ),
                    }
                )
                progress.update()
    return {'snrs_db': list(snrs_db), 'level': LEVEL, 'rows': rows}


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = [
        f'method  zones   µs a frame: talking   quiet   {SNR} for 80 % [dB]   false IDs/h (95 %)'
    ]
    for row in figures['rows']:
        needed = 'never' if row['needed_db'] is None else f'{row["needed_db"]:.1f}'
        false = row['false_ids']
        lines.append(
            f'{row["method"]:6}{row["zones"]:7}{row["frame_us"]["talking"]:22.0f}'
            f'{row["frame_us"]["quiet"]:8.0f}{needed:>20}'
            f'{false["per_hour"]:9.3g} ({false["low"]:.3g} to {false["high"]:.3g})'
        )
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set what both methods cost and need side by side."""
    claims = []
    for zones in _MODES:
        rows = {row['method']: row for row in figures['rows'] if row['zones'] == zones}
        both = [rows[method] for method in ('paper', METHODS[0]) if method in rows]
        for key, name in (('quiet', 'nothing modulating'), ('talking', 'three markers talking')):
            claims.append(
                Claim(
                    f'processor time of a frame of {zones} zones, median, {name}',
                    NOTHING,
                    *(f'{1e-3 * row["frame_us"][key]:.2f} ms' for row in both),
                )
            )
        claims.append(
            Claim(
                f'{SNR} that 80 % of lone packets need, {zones} zones',
                NOTHING,
                *(told(row['needed_db'], 'dB', 1) for row in both),
            )
        )
    return claims


def comment(figures: dict[str, Any]) -> str:
    """Say what is bought with the time."""
    return (
        'The times are those of this machine. False IDs are counted before a bare wall. Where a '
        f'method has no value it is below {figures["level"]:.0%} at the strongest link.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw link needed and false IDs over processor time."""
    figure, ((links, alarms),) = new_chart(1, 2, 14, 6.5)
    strongest = max(figures['snrs_db'])
    for row in figures['rows']:
        how = {**look(row['method']), 'markersize': 10, 'linestyle': ''}
        how['markerfacecolor'] = how['color'] if row['zones'] == min(_MODES) else 'white'
        times_us = [row['frame_us'][name] for name in ('talking', 'quiet')]
        needed = strongest + 1 if row['needed_db'] is None else row['needed_db']
        false = row['false_ids']
        # Where nothing was read, all that is known is the upper bound.
        per_hour = false['per_hour'] or false['high']
        for axis, value in ((links, needed), (alarms, per_hour)):
            axis.plot(times_us, [value, value], color=how['color'], linewidth=1)
            axis.plot(times_us[0], value, **how)
        if false['events']:
            alarms.vlines(times_us[0], false['low'], false['high'], colors=how['color'])
        else:
            alarms.annotate(
                '',
                (times_us[0], per_hour / 3),
                (times_us[0], per_hour),
                arrowprops={'arrowstyle': '->', 'color': how['color']},
            )
    links.axhline(strongest + 0.5, color='0.6', linewidth=0.8)
    links.set_ylim(min(figures['snrs_db']), strongest + 1.5)
    links.text(0.02, strongest + 1, 'never', transform=links.get_yaxis_transform(), va='center')
    links.set_ylabel(f'{SNR} needed to identify 80 % with one packet [dB]')
    alarms.set_yscale('log')
    alarms.set_ylim(1, 1e5)
    alarms.set_ylabel('false IDs an hour before a bare wall, 95 % confidence')
    times_us = [time_us for row in figures['rows'] for time_us in row['frame_us'].values()]
    for axis in (links, alarms):
        axis.set_xscale('log')
        axis.set_xlim(10 ** math.floor(math.log10(min(times_us))), 10 * max(times_us))
        axis.set_xlabel(
            'processor time of a frame [µs]; the sign with three markers talking, the line to none'
        )
    grids = {16: '4×4 zones, 47.6 Hz', 64: '8×8 zones, 15 Hz'}
    shared_legend(
        figure,
        'Computing time against accuracy',
        [
            (
                label,
                {
                    'marker': 'o',
                    'color': '0.2',
                    'linestyle': '',
                    'markerfacecolor': '0.2' if zones == min(_MODES) else 'white',
                },
            )
            for zones, label in grids.items()
        ],
    )
    figure.savefig(path)
