# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The picture of stage 8: range, bearing and the ellipsoid."""

from __future__ import annotations

from typing import Any

import numpy as np

from retrolidar_ros.evaluation.chain.pictures import OURS, PAPER, SMALL, TRUTH, panels
from retrolidar_ros.evaluation.live import ELLIPSOID
from retrolidar_ros.frame import Floats


def _ellipse(covariance: Floats, axes: tuple[int, int]) -> Floats:
    """Return the shadow of the 95 % ellipsoid on two axes, shape (2, points)."""
    turn = np.linspace(0, 2 * np.pi, 100)
    root = np.linalg.cholesky(covariance[np.ix_(axes, axes)])
    outline: Floats = np.sqrt(ELLIPSOID) * root @ np.stack([np.cos(turn), np.sin(turn)])
    return outline


def draw_place(figure: Any, figures: dict[str, Any]) -> None:
    """Draw range, shares of the zones, and the ellipsoid from above and from the side."""
    stage = figures['place']
    title = '8  The place: range, bearing, ellipsoid'
    scatter, shares, above, beside = panels(figure, title, (1.25, 1, 1, 1))
    scatter.scatter(
        stage['signal'], stage['distance_mm'], c=stage['light'], cmap='cividis', s=12, zorder=2
    )
    for name, colour, style, label in (
        ('truth_mm', TRUTH, '-', 'truth'),
        ('range_mm', OURS, '--', 'background taken off'),
        ('mean_mm', PAPER, ':', 'mean of all'),
        ('wall_mm', '0.5', '-.', 'wall'),
    ):
        scatter.axhline(stage[name], color=colour, linestyle=style, label=label)
    scatter.set_xlabel('signal [kcps/SPAD]')
    scatter.set_ylabel('range as reported [mm]')
    scatter.set_ylim(stage['truth_mm'] - 60, max(stage['distance_mm']) + 380)
    scatter.legend(loc='upper right', **SMALL)
    columns = stage['columns']
    half = stage['pitch'] * columns / 2
    amplitude = np.array(stage['amplitude']).reshape(-1, columns)
    shares.imshow(amplitude, cmap='Blues', extent=(-half, half, half, -half), vmin=0)
    for index, value in enumerate(stage['amplitude']):
        row, column = divmod(index, columns)
        x, y = (stage['pitch'] * (step - (columns - 1) / 2) for step in (column, row))
        dark = value > amplitude.max() / 2
        shares.text(x, y + 0.08, f'{value:.1f}', ha='center', color='w' if dark else 'k', **SMALL)
    truth, position = np.array(stage['truth_m']), np.array(stage['position_m'])
    shares.plot(*(truth[:2] / truth[2]), 'x', color=TRUTH, markersize=9, markeredgewidth=2)
    shares.plot(*(position[:2] / position[2]), '+', color='black', markersize=9)
    ticks = stage['pitch'] * (np.arange(columns + 1) - columns / 2)
    shares.set_xticks(ticks, [f'{tick:.2f}' for tick in ticks])
    shares.set_yticks(ticks, [f'{tick:.2f}' for tick in ticks])
    shares.set_xlabel('x/z')
    shares.set_ylabel('y/z')
    shares.set_title('modulation of zones\n[kcps/SPAD]', fontsize=9)
    covariance = np.array(stage['covariance_mm2'])
    for panel, axes, name in ((above, (0, 2), 'from above'), (beside, (2, 1), 'from the side')):
        x, y = 1e3 * position[list(axes)]
        outline = _ellipse(covariance, axes)
        panel.fill(x + outline[0], y + outline[1], color=OURS, alpha=0.2, linewidth=0)
        panel.plot(x, y, '+', color='black', markersize=9, label='said')
        true = 1e3 * truth[list(axes)]
        panel.plot(*true, 'x', color=TRUTH, markersize=9, markeredgewidth=2, label='true')
        panel.set_title(f'{name}, with the\n95 % ellipsoid', fontsize=9)
        panel.set_xlabel(f'{"xyz"[axes[0]]} [mm]')
        panel.set_ylabel(f'{"xyz"[axes[1]]} [mm]')
        panel.set_aspect('equal', adjustable='datalim')
        panel.legend(loc='upper right', **SMALL)
    beside.invert_yaxis()
