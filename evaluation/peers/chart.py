# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The charts of LiDAR markers beside visual markers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from evaluation.peers.visual_markers import APRILTAG, APRILTAG_FINE, QR
from evaluation.report.charts import LEVEL, draw_shares, look, new_chart
from retrolidar_ros.detector import METHODS

METHODS = (METHODS[0], 'paper')
SPEED_ACCURACY = 'speed.png'
"""The chart of reach and error over processor time, beside the other one."""
_PEER_LOOKS = {
    APRILTAG: {'color': '#e69f00', 'marker': 'v', 'markersize': 4},
    APRILTAG_FINE: {'color': '#56b4e9', 'marker': 'P', 'markersize': 4},
    QR: {'color': '0.2', 'marker': 'X', 'markersize': 4},
}
_DOTTED = {'linestyle': ':', 'marker': ''}
COMPARED_AT_M = 2.0
# Offset [points], and which side of the text is there; they keep the names apart.
_LABEL_PLACES = {
    'joint': ((13, 0), 'left', 'center'),
    'paper': ((13, 0), 'left', 'center'),
    APRILTAG: ((-12, 0), 'right', 'center'),
    APRILTAG_FINE: ((0, 13), 'center', 'bottom'),
    QR: ((0, 13), 'center', 'bottom'),
}


def _look(name: str) -> dict[str, Any]:
    return _PEER_LOOKS[name] if name in _PEER_LOOKS else look(name)


def _curve(figures: dict[str, Any], size_m: float) -> list[dict[str, Any]]:
    return [place for place in figures['places'] if place['size_m'] == size_m]


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over distance, light and glare, range error, and processor time."""
    figure, axes = new_chart(2, 3, 15, 9)
    names = [*METHODS, *figures['readers']]
    sizes = sorted({place['size_m'] for place in figures['places']}, reverse=True)
    for panel, size_m in zip(axes[0], sizes, strict=False):
        curve = _curve(figures, size_m)
        for name in names:
            draw_shares(
                panel,
                [place['range_m'] for place in curve],
                [place['results'][name]['read'] for place in curve],
                **_look(name),
            )
        panel.axhline(100 * LEVEL, color='0.6', linewidth=0.8)
        panel.set_title(f'markers of {100 * size_m:.0f} cm', fontsize=12)
        panel.set_xlabel('distance [m]', fontsize=11)
    _draw_errors(axes[0, 2], _curve(figures, sizes[0]), names)
    _draw_sweeps(axes[1], figures)
    _draw_costs(axes[1, 2], figures, names)
    for panel in (*axes[0, :2], *axes[1, :2]):
        panel.set_ylim(0, 103)
    for row in axes:
        row[0].set_ylabel('read rightly in one packet or picture [%]', fontsize=11)
    _legend(figure, names)
    figure.savefig(path)
    draw_speed_accuracy(figures, path.with_name(SPEED_ACCURACY))


def _draw_errors(panel: Any, curve: list[dict[str, Any]], names: list[str]) -> None:
    for name in names:
        places = [place for place in curve if place['results'][name]['error_mm']]
        for which, how in (('median', {}), ('p95', _DOTTED)):
            panel.plot(
                [place['range_m'] for place in places],
                [place['results'][name]['error_mm'][which] for place in places],
                **{**_look(name), **how},
            )
    panel.set_yscale('log')
    panel.set_title('3 cm: median (solid), 95 % (dotted)', fontsize=12)
    panel.set_xlabel('distance [m]', fontsize=11)
    panel.set_ylabel('error of range, where read [mm]', fontsize=11)


def _draw_sweeps(panels: Any, figures: dict[str, Any]) -> None:
    at = figures['sweep']
    where = f'{100 * at["size_m"]:.0f} cm at {at["range_m"]:.0f} m'
    for panel, rows, key in (
        (panels[0], figures['lights'], 'lux'),
        (panels[1], figures['glares'], 'veil'),
    ):
        for name in figures['readers']:
            draw_shares(
                panel,
                [row[key] for row in rows],
                [row['results'][name]['read'] for row in rows],
                **_look(name),
            )
    place = next(place for place in figures['places'] if at.items() <= place.items())
    for name in METHODS:
        share = place['results'][name]['read']['rate']
        panels[0].axhline(100 * share, color=_look(name)['color'], linestyle='--', linewidth=1.2)
    panels[0].set_xscale('log')
    panels[0].invert_xaxis()
    panels[0].set_title(f'{where}, in the dark (dashed: LiDAR, own light)', fontsize=12)
    panels[0].set_xlabel('light on the marker [lux]', fontsize=11)
    panels[1].set_title(f'{where}, under glare', fontsize=12)
    panels[1].set_xlabel('veil of glare, as a share of white paper', fontsize=11)


def _draw_costs(panel: Any, figures: dict[str, Any], names: list[str]) -> None:
    for size_m, how in ((0.03, {}), (0.01, _DOTTED)):
        curve = _curve(figures, size_m)
        for name in names:
            panel.plot(
                [place['range_m'] for place in curve],
                [place['cpu_ms'][name] for place in curve],
                **{**_look(name), **how},
            )
    panel.set_yscale('log')
    panel.set_title('3 cm (solid), 1 cm (dotted); LiDAR: three talking', fontsize=12)
    panel.set_xlabel('distance [m]', fontsize=11)
    panel.set_ylabel('processor time per second of watching [ms]', fontsize=11)


def _legend(figure: Any, names: list[str]) -> None:
    from matplotlib.lines import Line2D

    figure.legend(
        handles=[
            Line2D([], [], label=f'LiDAR, {name}' if name in METHODS else name, **_look(name))
            for name in names
        ],
        loc='outside upper center',
        ncols=len(names),
        frameon=False,
        fontsize=12,
    )


def draw_speed_accuracy(figures: dict[str, Any], path: Path) -> None:
    """Draw reach and range error of everything over its processor time.

    What never reaches the level stands at the bottom with an empty sign; what is not read at
    `COMPARED_AT_M` is missing on the right.
    """
    figure, ((reach, error),) = new_chart(1, 2, 14, 6)
    place = next(place for place in _curve(figures, 0.03) if place['range_m'] == COMPARED_AT_M)
    costs_ms = {name: figures['reading'][name]['cpu_ms'] for name in figures['reading']}
    for name, cost_ms in costs_ms.items():
        how = {**_look(name), 'markersize': 14, 'linestyle': '', 'clip_on': False}
        reach_m = figures['reading'][name]['reach_m']['3 cm']['single']
        if reach_m is None:
            how['markerfacecolor'] = 'white'
        reach.plot(cost_ms, reach_m or 0.0, **how)
        _label(reach, name, (cost_ms, reach_m or 0.0), '' if reach_m else ': nowhere')
        errors = place['results'][name]['error_mm']
        if errors:
            error.plot(cost_ms, errors['median'], **{**how, 'markerfacecolor': how['color']})
            _label(error, name, (cost_ms, errors['median']))
    reach.set_title(f'How far {LEVEL:.0%} of markers of 3 cm are read [m]', fontsize=16)
    error.set_title(f'Median error of range at {COMPARED_AT_M:.0f} m [mm]', fontsize=16)
    for panel in (reach, error):
        panel.set_xscale('log')
        panel.xaxis.set_major_formatter('{x:g}')
        panel.set_xlim(min(costs_ms.values()) / 3, 4 * max(costs_ms.values()))
        panel.set_ylim(-0.06 * panel.dataLim.ymax, 1.15 * panel.dataLim.ymax)
        panel.tick_params(labelsize=13)
        panel.set_xlabel('processor time per second of watching [ms]', fontsize=14)
    figure.savefig(path)


def _label(panel: Any, name: str, point: tuple[float, float], more: str = '') -> None:
    """Write a name beside its point."""
    offset, across, up = _LABEL_PLACES[name]
    panel.annotate(
        f'LiDAR, {name}{more}' if name in METHODS else name,
        point,
        offset,
        textcoords='offset points',
        ha=across,
        va=up,
        fontsize=14,
        color=_look(name)['color'],
    )
