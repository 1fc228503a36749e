# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The paper's values of LiDAR markers beside visual markers, and ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from evaluation.peers.visual_markers import APRILTAG, QR
from evaluation.report.charts import LEVEL
from evaluation.report.claims import NOTHING, Claim


def metres(reach_m: float | None) -> str:
    """Write a reach."""
    return 'nowhere' if reach_m is None else f'{reach_m:.2f} m'


def reach_m(figures: dict[str, Any], name: str, size: str, time: str = 'single') -> float | None:
    """Return a reach [m], None for too little or a reader that is missing."""
    if name in figures['missing']:
        return None
    reach: float | None = figures['reading'][name]['reach_m'][size][time]
    return reach


def error_mm(figures: dict[str, Any], name: str, range_m: float, which: str) -> float | None:
    """Return an error of range [mm] at 3 cm, None if nothing was read there or it is missing."""
    for place in figures['places']:
        if (place['size_m'], place['range_m']) == (0.03, range_m) and name in place['results']:
            error = place['results'][name]['error_mm']
            return error and float(error[which])
    return None


def text(value: float | None, form: str) -> str:
    """Write a value in a form of `str.format`, or that there is none."""
    return NOTHING if value is None else form.format(value)


def more(value: float | None, than: float | None) -> float | None:
    """Return by what share a value is larger than another."""
    ratio = _ratio(value, than)
    return None if ratio is None else ratio - 1


def _ratio(upper: float | None, lower: float | None) -> float | None:
    return None if upper is None or lower is None else upper / lower


def compare(figures: dict[str, Any]) -> list[Claim]:
    """Return what the paper says of both kinds of marker beside what was measured here."""
    default = figures['methods'][0]

    def both(what: str, paper: str, form: str, value: Callable[[str], float | None]) -> Claim:
        return Claim(what, paper, *(text(value(name), form) for name in ('paper', default)))

    def peer(what: str, paper: str, form: str, value: float | None) -> Claim:
        return Claim(what, paper, default=text(value, form))

    def cost(name: str) -> float | None:
        return None if name in figures['missing'] else figures['reading'][name]['cpu_ms']

    return [
        both(
            f'LiDAR, 3 cm: {LEVEL:.0%} are read to',
            '2.6 m',
            '{:.2f} m',
            lambda n: reach_m(figures, n, '3 cm'),
        ),
        both(
            f'LiDAR, 1 cm: {LEVEL:.0%} are read to',
            '1.3 m',
            '{:.2f} m',
            lambda n: reach_m(figures, n, '1 cm'),
        ),
        both(
            'LiDAR, 3 cm: half are read to',
            NOTHING,
            '{:.2f} m',
            lambda n: reach_m(figures, n, '3 cm', 'single_half'),
        ),
        both(
            'LiDAR, 1 cm: half are read to',
            NOTHING,
            '{:.2f} m',
            lambda n: reach_m(figures, n, '1 cm', 'single_half'),
        ),
        peer(
            f'AprilTag, 3 cm: {LEVEL:.0%} are read to',
            '2.2 to 2.4 m',
            '{:.2f} m',
            reach_m(figures, APRILTAG, '3 cm'),
        ),
        peer(
            f'AprilTag, 1 cm: {LEVEL:.0%} are read to',
            'below 0.9 m',
            '{:.2f} m',
            reach_m(figures, APRILTAG, '1 cm'),
        ),
        peer(
            f'QR code, 3 cm: {LEVEL:.0%} are read to',
            'below 1 m',
            '{:.2f} m',
            reach_m(figures, QR, '3 cm'),
        ),
        peer(
            'AprilTag, 3 cm at 1 m: median error of range',
            'below 4 mm',
            '{:.1f} mm',
            error_mm(figures, APRILTAG, 1.0, 'median'),
        ),
        peer(
            'AprilTag, 3 cm at 2.4 m: median error of range',
            '11.7 mm',
            '{:.1f} mm',
            error_mm(figures, APRILTAG, 2.4, 'median'),
        ),
        peer(
            'AprilTag, 3 cm at 2.4 m: largest error of range',
            '156.2 mm',
            '{:.1f} mm',
            error_mm(figures, APRILTAG, 2.4, 'largest'),
        ),
        both(
            'LiDAR at 2.4 m: median error of range, of that of AprilTag',
            '-85 %, at no named distance',
            '{:+.0%}',
            lambda n: more(
                error_mm(figures, n, 2.4, 'median'), error_mm(figures, APRILTAG, 2.4, 'median')
            ),
        ),
        both(
            'LiDAR, 1 cm: read farther than AprilTag',
            '+44 %',
            '{:+.0%}',
            lambda n: more(reach_m(figures, n, '1 cm'), reach_m(figures, APRILTAG, '1 cm')),
        ),
        both(
            'LiDAR, 3 cm: reach over that of the QR code',
            '2.6',
            '{:.1f}',
            lambda n: _ratio(reach_m(figures, n, '3 cm'), reach_m(figures, QR, '3 cm')),
        ),
        both(
            'Processor time per second of watching: AprilTag over LiDAR',
            NOTHING,
            '{:.0f}',
            lambda n: _ratio(cost(APRILTAG), cost(n)),
        ),
    ]
