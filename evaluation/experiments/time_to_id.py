# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""How long it takes until a repeating marker that comes into view is identified."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from evaluation.bench.detectors import new_detector
from evaluation.bench.link import SILENCE_BITS, Trial, link_scene, read
from evaluation.bench.rates import frequency
from evaluation.bench.stress import appear, light_of, sensed
from evaluation.bench.sweep import told
from evaluation.report.charts import look, new_chart, shared_legend
from evaluation.report.claims import NOTHING, Claim
from retrolidar_ros.detector import METHODS, Detector
from retrolidar_ros.marker.code import BIT_PERIOD_S
from retrolidar_ros.scene.marker_budget import SNR
from retrolidar_ros.scene.reference import SENSOR
from retrolidar_ros.scene.truth import PACKET_S

TITLE = 'Time to the first ID'
SOURCE = ''

TIMEOUT_S = 20.0
VIEW_S = SILENCE_BITS * BIT_PERIOD_S  # when the markers come into view
_SNRS_DB = (2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 14.0, 16.0)
_QUICK_SNRS_DB = (6.0, 14.0)
_SCENES, _QUICK_SCENES = 2, 1
_SHARES = (0.5, 0.9)
_SHOWN_DB = (6.0, 14.0)  # whose distributions are drawn in full


def appearing(snr_db: float, rng: np.random.Generator) -> Trial:
    """Return markers that have always been sending and come into view at `VIEW_S`."""
    scene = link_scene(snr_db, rng, packets=None)
    light = appear(light_of(scene, rng, VIEW_S + TIMEOUT_S), VIEW_S)
    return Trial(scene, sensed(light, scene.sensor, rng))


def first_ids(trial: Trial, detector: Detector) -> tuple[NDArray[np.float64], int]:
    """Return the time from view to the first right ID of each zone, and how many IDs were wrong.

    The times are in seconds, infinite where there was no right ID, shape (zones,).
    """
    times_s = np.full(trial.recording.grid.zones, math.inf)
    wrong = 0
    for reading in read(trial, detector):
        if reading.right:
            since_s = reading.end_ns * 1e-9 - VIEW_S
            times_s[reading.zone] = min(times_s[reading.zone], since_s)
        else:
            wrong += 1
    return times_s, wrong


def time_by_which(share: float, times_s: NDArray[np.float64]) -> float | None:
    """Return the time by which a share of all has been identified; None = never."""
    time_s = float(np.sort(times_s)[math.ceil(share * len(times_s)) - 1])
    return time_s if math.isfinite(time_s) else None


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return times to the first right ID and wrong IDs a marker and hour, over the link."""
    snrs_db, scenes = (_QUICK_SNRS_DB, _QUICK_SCENES) if quick else (_SNRS_DB, _SCENES)
    methods: dict[str, list[dict[str, Any]]] = {method: [] for method in METHODS}
    with tqdm(total=len(snrs_db) * scenes, desc='time-to-id', leave=False) as progress:
        for snr_db in snrs_db:
            times_s: dict[str, list[NDArray[np.float64]]] = {method: [] for method in METHODS}
            wrong = dict.fromkeys(METHODS, 0)
            for _ in range(scenes):
                trial = appearing(snr_db, rng)
                for method in METHODS:
                    times, errors = first_ids(trial, new_detector(method, SENSOR.grid))
                    times_s[method].append(times)
                    wrong[method] += errors
                progress.update()
            for method in METHODS:
                all_s = np.sort(np.concatenate(times_s[method]))
                methods[method].append(
                    {
                        'snr_db': snr_db,
                        'markers': len(all_s),
                        'times_s': np.round(all_s[np.isfinite(all_s)], 3).tolist(),
                        'by_share_s': [time_by_which(share, all_s) for share in _SHARES],
                        'wrong_ids': frequency(
                            wrong[method], len(all_s) * (VIEW_S + TIMEOUT_S) / 3600
                        ),
                    }
                )
    return {'timeout_s': TIMEOUT_S, 'shares': list(_SHARES), 'methods': methods}


def _seconds(time_s: float | None) -> str:
    return f'>{TIMEOUT_S:g}' if time_s is None else f'{time_s:.1f}'


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    shares = ''.join(f'  {share:.0%} by [s]' for share in figures['shares'])
    lines = [f'method  {SNR} [dB]{shares}   wrong IDs a marker and hour']
    for method, rows in figures['methods'].items():
        for row in rows:
            times = ''.join(f'{_seconds(time_s):>12}' for time_s in row['by_share_s'])
            lines.append(
                f'{method:6}{row["snr_db"]:10g}{times}{row["wrong_ids"]["per_hour"]:30.1f}'
            )
    return '\n'.join(lines)


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the times of both methods side by side."""
    claims = []
    for index, row in enumerate(figures['methods']['joint']):
        if row['snr_db'] not in _SHOWN_DB:
            continue
        both = [figures['methods'][method][index] for method in ('paper', 'joint')]
        for column, share in enumerate(figures['shares']):
            claims.append(
                Claim(
                    f'{share:.0%} are identified at {row["snr_db"]:g} dB within',
                    NOTHING,
                    *(told(one['by_share_s'][column], 's') for one in both),
                )
            )
        claims.append(
            Claim(
                f'wrong IDs a marker and hour at {row["snr_db"]:g} dB',
                'not told',
                *(f'{one["wrong_ids"]["per_hour"]:.0f}' for one in both),
            )
        )
    return claims


def comment(figures: dict[str, Any]) -> str:
    """Say from where the time counts."""
    return (
        'Markers that have always been sending come into view; the time counts from then to the '
        f'first right ID, for {figures["timeout_s"]:g} s at most. A packet takes '
        f'{PACKET_S:.3f} s. Method `joint` reads from any bit of a repeated '
        'packet, so it need not wait for its beginning; but then every 31 bits in a row look like '
        'a packet, so it must be surer. The paper gives no such times but those of its coffee arm.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw times over the link, two distributions in full, and wrong IDs."""
    figure, ((over_link, wrong), distributions) = new_chart(2, 2, 14, 10)
    for method, rows in figures['methods'].items():
        snrs_db = [row['snr_db'] for row in rows]
        for index, style in enumerate(('-', '--')):
            times_s = [row['by_share_s'][index] for row in rows]
            over_link.plot(
                snrs_db,
                [figures['timeout_s'] if time_s is None else time_s for time_s in times_s],
                linestyle=style,
                **look(method),
            )
        per_hour = [row['wrong_ids']['per_hour'] for row in rows]
        bounds = [[row['wrong_ids'][end] for row in rows] for end in ('low', 'high')]
        wrong.plot(snrs_db, per_hour, **look(method))
        wrong.fill_between(snrs_db, *bounds, color=look(method)['color'], alpha=0.13, linewidth=0)
        for axis, snr_db in zip(distributions, _SHOWN_DB, strict=True):
            row = rows[snrs_db.index(snr_db)]
            shares = 100 * np.arange(len(row['times_s']) + 1) / row['markers']
            axis.step(
                [0.0, *row['times_s'], figures['timeout_s']],
                [*shares, shares[-1]],
                where='post',
                color=look(method)['color'],
            )
            axis.set_title(f'{SNR} = {snr_db:g} dB', fontsize=11)
    over_link.set_title('time until half (solid) and nine tenths (dashed) are identified')
    over_link.set_ylabel('from view to first right ID [s]')
    over_link.set_ylim(0, figures['timeout_s'] * 1.03)
    over_link.text(
        0.98,
        figures['timeout_s'] * 0.97,
        f'at {figures["timeout_s"]:g} s: not yet',
        ha='right',
        va='top',
        transform=over_link.get_yaxis_transform(),
    )
    wrong.set_title('wrong IDs, 95 % confidence')
    wrong.set_ylabel('wrong IDs a marker and hour')
    # Linear below one, for none has no logarithm.
    wrong.set_yscale('symlog', linthresh=1)
    wrong.set_ylim(bottom=0)
    for axis in (over_link, wrong):
        axis.set_xlabel(f'{SNR} [dB]')
    for axis in distributions:
        axis.set_xlabel('from view to first right ID [s]')
        axis.set_ylabel('markers identified [%]')
        axis.set_ylim(-2, 102)
    shared_legend(figure, 'Markers that repeat without a pause and come into view', [])
    figure.savefig(path)
