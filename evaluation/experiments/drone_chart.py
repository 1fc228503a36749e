# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The chart of the experiment `drone`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from evaluation.report.charts import look, new_chart, shared_legend
from retrolidar_ros.scene.files import load_scene
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.tasks.heartbeat import WINDOW_S

SHOWN = ('joint', 'paper')
"""Whose readings are drawn over time."""
_STEP_S = 0.02  # in which the motion is drawn


def _draw_track(axis: Any, figures: dict[str, Any], truth: Floats, key: str, index: int) -> None:
    """Draw one coordinate of the first run over time: the truth as a line, readings as dots."""
    times_s = np.linspace(0, figures['duration_s'], len(truth))
    axis.plot(times_s, truth, color='0.55', linewidth=1.2)
    for method in reversed(SHOWN):
        first = figures['methods'][method]['first_run']
        values = np.array(first[key]).reshape(len(first['moment_s']), -1)
        axis.plot(first['moment_s'], values[:, index], linestyle='', alpha=0.8, **look(method))
    axis.set_xlim(0, figures['duration_s'])
    axis.set_xlabel('time [s]')


def _draw_silences(axis: Any, figures: dict[str, Any]) -> None:
    """Draw how much of the time belongs to silences longer than each."""
    longest_s = max(row['silences_s'][-1] for row in figures['methods'].values())
    edges = np.linspace(0, longest_s, 300)
    for method, row in figures['methods'].items():
        silences_s = np.array(row['silences_s'])
        share = [100 * silences_s[silences_s > edge].sum() / silences_s.sum() for edge in edges]
        axis.plot(edges, share, color=look(method)['color'])
    axis.axvline(WINDOW_S, color='0.4', linestyle='--', linewidth=1)
    axis.text(WINDOW_S + 0.2, 90, 'a window', color='0.3', fontsize=10)
    axis.set_xlim(0, 1.03 * longest_s)
    axis.set_xlabel('silence [s]')
    axis.set_ylabel('time spent in longer silences [%]')
    axis.set_title('how long silences last, all runs')


def _draw_heartbeats(axis: Any, figures: dict[str, Any]) -> None:
    """Draw when each method read in the first run, one line each."""
    names = list(figures['methods'])
    for index, method in enumerate(names):
        known_s = figures['methods'][method]['first_run']['known_s']
        axis.vlines(known_s, index - 0.35, index + 0.35, color=look(method)['color'], linewidth=1.2)
    axis.set_yticks(range(len(names)))
    axis.set_yticklabels(names)
    axis.invert_yaxis()
    axis.grid(axis='y', visible=False)
    axis.set_xlim(0, figures['duration_s'])
    axis.set_xlabel('time [s]')
    axis.set_title('readings of the first run')


def _draw_windows(axis: Any, figures: dict[str, Any]) -> None:
    """Draw the shares of windows with a reading, with their confidence."""
    width = 0.8 / len(figures['methods'])
    for index, (method, row) in enumerate(figures['methods'].items()):
        rates = [one['alive'] for one in row['windows']]
        places = np.arange(len(rates)) - 0.4 + width * (index + 0.5)
        shares = np.array([one['rate'] for one in rates])
        # Rounding may put a share of all beside its own bound.
        above = np.maximum([one['high'] for one in rates] - shares, 0)
        below = np.maximum(shares - [one['low'] for one in rates], 0)
        axis.bar(places, 100 * shares, 0.9 * width, color=look(method)['color'])
        axis.errorbar(
            places, 100 * shares, [100 * below, 100 * above], fmt='none', ecolor='0.2', capsize=2
        )
    paper = figures['paper']
    windows_s = [one['window_s'] for one in next(iter(figures['methods'].values()))['windows']]
    last = len(windows_s) - 1
    axis.plot(
        [last - 0.45, last + 0.45],
        [100 * paper['rate']] * 2,
        color='0',
        linestyle='--',
        linewidth=2,
        label=f'the paper reports {paper["rate"]:.0%}',
    )
    axis.legend(loc='upper left', fontsize=10)
    axis.set_xticks(range(len(windows_s)))
    axis.set_xticklabels([f'{window_s:g} s' for window_s in windows_s])
    axis.set_ylim(0, 119)  # with room for the legend
    axis.set_yticks(range(0, 101, 20))
    axis.grid(axis='x', visible=False)
    axis.set_xlabel('length of a window')
    axis.set_ylabel('windows with a reading [%]')
    axis.set_title('heartbeats, all runs, 95 % confidence')


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw range and place over time, silences, and windows with a reading."""
    (marker,) = load_scene('drone').markers
    truth_m = position_at(marker, np.arange(0, figures['duration_s'], _STEP_S))
    figure, axes = new_chart(3, 2, 16, 12)
    _draw_track(axes[0, 0], figures, np.linalg.norm(truth_m, axis=1), 'range_m', 0)
    _draw_track(axes[1, 0], figures, truth_m[:, 0], 'place_m', 0)
    _draw_track(axes[2, 0], figures, truth_m[:, 1], 'place_m', 1)
    dots = ' and '.join(SHOWN)
    axes[0, 0].set_title(f'first run: truth (line) and readings of {dots} (dots)')
    for axis, label in zip(axes[:, 0], ('range [m]', 'x [m]', 'y [m]'), strict=True):
        axis.set_ylabel(label)
    _draw_heartbeats(axes[0, 1], figures)
    _draw_silences(axes[1, 1], figures)
    _draw_windows(axes[2, 1], figures)
    shared_legend(figure, 'A drone that drifts over four zones, and whose rotor hides it', [])
    figure.savefig(path)
