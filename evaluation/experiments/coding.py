# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What the code corrects: bit errors of readings over distance, and what likelihood adds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from evaluation.bench.link import lone_trial
from evaluation.bench.rates import rate
from evaluation.bench.sweep import WAKING_S
from evaluation.report.charts import draw_shares, look, new_chart
from evaluation.report.claims import Claim
from retrolidar_ros.detector import METHODS, create_detector
from retrolidar_ros.scene.reference import marker_in_each_zone

TITLE = 'Coding gain'
SOURCE = 'paper §6.4, Fig. 11d'
PAPER_CLEAN, PAPER_FAR_M, PAPER_FAR_BROKEN = 0.89, 2.8, 0.48
PAPER_SURE_M = 2.0
MOST = 4
"""So many errors or more are counted together."""
_RANGES_M = (1.0, 1.5, 2.0, 2.2, 2.4, 2.6, 2.8, 3.0)
_QUICK_RANGES_M = (1.0, 2.0, 2.8)
_SCENES, _QUICK_SCENES = 8, 1


def run(rng: np.random.Generator, *, quick: bool) -> dict[str, Any]:
    """Return identification, and how many bits of right readings were wrong, over distance."""
    ranges = _QUICK_RANGES_M if quick else _RANGES_M
    scenes = _QUICK_SCENES if quick else _SCENES
    points = []
    for range_m in tqdm(ranges, desc='coding', leave=False):
        errors: dict[str, list[int]] = {method: [] for method in METHODS}
        markers = 0
        for _ in range(scenes):
            trial = lone_trial(marker_in_each_zone(range_m, rng, start_s=WAKING_S), rng)
            own = {zone: marker.id for zone, marker in enumerate(trial.scene.markers)}
            markers += len(own)
            for method in METHODS:
                detector = create_detector(method, trial.recording.grid)
                errors[method] += [
                    detection.corrected_bits
                    for detection in detector.update_all(trial.recording)
                    if detection.id == own[detection.zones[0]]
                ]
        points.append(
            {
                'range_m': range_m,
                'markers': markers,
                **{method: _counted(found, markers) for method, found in errors.items()},
            }
        )
    return {'points': points}


def _counted(errors: list[int], markers: int) -> dict[str, Any]:
    """Return how many readings there were, and how many had no, one, … wrong bits."""
    counts = np.bincount(np.minimum(errors, MOST).astype(int), minlength=MOST + 1)
    clean = int(counts[0])
    return {
        'identified': rate(min(len(errors), markers), markers),
        'errors': counts.tolist(),
        'without_code': rate(min(clean, markers), markers),
        'clean': rate(clean, len(errors)) if errors else None,
    }


def summarise(figures: dict[str, Any]) -> str:
    """Return a table of the figures."""
    lines = ['readings with 0, 1, 2, 3, more wrong bits (identified; without any wrong bit)']
    for row in figures['points']:
        lines.append(f'{row["range_m"]:.1f} m')
        lines += [
            f'  {method:6} '
            + ' '.join(f'{count:5d}' for count in row[method]['errors'])
            + f'   ({row[method]["identified"]["rate"]:.1%}; '
            f'{row[method]["without_code"]["rate"]:.1%})'
            for method in METHODS
        ]
    return '\n'.join(lines)


def _at(figures: dict[str, Any], range_m: float) -> dict[str, Any]:
    row: dict[str, Any] = min(
        figures['points'], key=lambda point: abs(float(point['range_m']) - range_m)
    )
    return row


def _clean(row: dict[str, Any], method: str, *, broken: bool = False) -> str:
    share = row[method]['clean']
    if share is None:
        return 'none read'
    return f'{1 - share["rate"] if broken else share["rate"]:.0%}'


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Set the share of readings that need the code beside the paper's."""
    sure, far = _at(figures, PAPER_SURE_M), _at(figures, PAPER_FAR_M)
    return [
        Claim(
            f'right readings without any wrong bit at {sure["range_m"]:g} m',
            f'{PAPER_CLEAN:.0%}, where all are read',
            *(_clean(sure, method) for method in ('paper', 'joint')),
        ),
        Claim(
            f'right readings with wrong bits at {far["range_m"]:g} m',
            f'{PAPER_FAR_BROKEN:.0%}',
            *(_clean(far, method, broken=True) for method in ('paper', 'joint')),
        ),
        Claim(
            f'identified at {far["range_m"]:g} m with the code',
            'not told; its range ends at 2.6 m',
            *(f'{far[method]["identified"]["rate"]:.0%}' for method in ('paper', 'joint')),
        ),
        Claim(
            f'identified at {far["range_m"]:g} m, if no wrong bit were corrected',
            'not told',
            *(f'{far[method]["without_code"]["rate"]:.0%}' for method in ('paper', 'joint')),
        ),
    ]


def comment(figures: dict[str, Any]) -> str:
    """Say what both ways of decoding make of the same packets."""
    far = _at(figures, PAPER_FAR_M)
    shares = ', '.join(f'`{method}` {far[method]["identified"]["rate"]:.0%}' for method in METHODS)
    beyond = far['joint']['errors'][MOST]
    return (
        f'Of the same packets at {far["range_m"]:g} m are identified: {shares}. `paper` '
        'decides each bit and lets the Golay code correct three; `joint` weighs all samples, '
        f'and {beyond} of its readings there had {MOST} wrong bits or more, '
        'which the code alone does not correct. Wrong bits are counted after a matched filter by '
        'the default, and after one threshold for all samples by `paper`.'
    )


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw wrong bits of readings over distance, and identification with and without the code."""
    figure, axes = new_chart(1, 3, 17, 5)
    points = figures['points']
    places = [row['range_m'] for row in points]
    shades = ('#08306b', '#2b7bba', '#7db8da', '#fdae6b', '#d94801')
    for axis, method in zip(axes[0], ('paper', 'joint'), strict=False):
        below = np.zeros(len(points))
        for wrong in range(MOST + 1):
            read = np.array([100 * row[method]['errors'][wrong] / row['markers'] for row in points])
            label = f'{wrong}' if wrong < MOST else f'{MOST} or more'
            axis.bar(range(len(places)), read, 0.8, below, color=shades[wrong], label=label)
            below += read
        axis.set_xticks(range(len(places)), [f'{place:g}' for place in places])
        axis.set_ylim(0, 103)
        axis.set_xlabel('distance of a marker of 3 cm [m]')
        axis.set_ylabel('packets read rightly [%]')
        axis.set_title(f'{method}: wrong bits of right readings', fontsize=12)
        axis.grid(axis='x', visible=False)
    axes[0, 1].legend(title='wrong bits', fontsize=10, loc='lower left', framealpha=1)
    methods = axes[0, 2]
    for method in METHODS:
        rates = [row[method]['identified'] for row in points]
        draw_shares(methods, places, rates, label=method, **look(method))
        shares = [100 * row[method]['without_code']['rate'] for row in points]
        methods.plot(places, shares, color=look(method)['color'], linestyle=':')
    methods.set_ylim(-2, 103)
    methods.set_xlabel('distance [m]')
    methods.set_ylabel('lone packets identified [%]')
    methods.set_title('with the code, and dotted without', fontsize=12)
    methods.legend(fontsize=10)
    figure.savefig(path)
