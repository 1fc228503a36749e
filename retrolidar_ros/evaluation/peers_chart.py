# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The charts of LiDAR markers beside visual markers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from retrolidar_ros.detector import METHODS
from retrolidar_ros.evaluation.charts import LEVEL, draw_shares, look, new_chart
from retrolidar_ros.evaluation.visual_markers import APRILTAG, APRILTAG_FINE, QR

COMPARED = (METHODS[0], 'paper')
_PEER_LOOKS = {
    APRILTAG: {'color': '#e69f00', 'marker': 'v', 'markersize': 4},
    APRILTAG_FINE: {'color': '#56b4e9', 'marker': 'P', 'markersize': 4},
    QR: {'color': '0.2', 'marker': 'X', 'markersize': 4},
}
COMPARED_AT_M = 2.0


def _look(name: str) -> dict[str, Any]:
    return _PEER_LOOKS[name] if name in _PEER_LOOKS else look(name)


def _curve(figures: dict[str, Any], size_m: float) -> list[dict[str, Any]]:
    return [place for place in figures['places'] if place['size_m'] == size_m]


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw identification over distance, light and glare, range error, and processor time."""
    figure, axes = new_chart(2, 3, 15, 9)
    names = [*COMPARED, *figures['readers']]
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


def _draw_errors(panel: Any, curve: list[dict[str, Any]], names: list[str]) -> None:
    for name in names:
        places = [place for place in curve if place['results'][name]['error_mm']]
        for which, style in (('median', '-'), ('p95', ':')):
            panel.plot(
                [place['range_m'] for place in places],
                [place['results'][name]['error_mm'][which] for place in places],
                linestyle=style,
                **_look(name),
            )
    panel.set_yscale('log')
    panel.set_title('markers of 3 cm: median (solid), 95 % (dotted)', fontsize=12)
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
    for name in COMPARED:
        share = place['results'][name]['read']['rate']
        panels[0].axhline(100 * share, color=_look(name)['color'], linestyle='--', linewidth=1.2)
    panels[0].set_xscale('log')
    panels[0].invert_xaxis()
    panels[0].set_title(f'{where}, into the dark (LiDAR, dashed: its own light)', fontsize=12)
    panels[0].set_xlabel('light on the marker [lux]', fontsize=11)
    panels[1].set_title(f'{where}, under glare', fontsize=12)
    panels[1].set_xlabel('veil of glare, as a share of white paper', fontsize=11)


def _draw_costs(panel: Any, figures: dict[str, Any], names: list[str]) -> None:
    for place_size, style in ((0.03, '-'), (0.01, ':')):
        curve = _curve(figures, place_size)
        for name in names:
            panel.plot(
                [place['range_m'] for place in curve],
                [place['cpu_ms'][name] for place in curve],
                linestyle=style,
                **_look(name),
            )
    panel.set_yscale('log')
    panel.set_title('cost; 3 cm (solid), 1 cm (dotted)', fontsize=12)
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
    """Draw reach and range error of everything over its processor time."""
    figure, ((reach, error),) = new_chart(1, 2, 14, 6)
    place = next(place for place in _curve(figures, 0.03) if place['range_m'] == COMPARED_AT_M)
    for name in (*figures['methods'], *figures['readers']):
        reading = figures['reading'][name]
        how = {**_look(name), 'markersize': 13, 'linestyle': ''}
        errors = place['results'][name]['error_mm']
        values = (
            (reach, reading['reach_m']['3 cm']['single']),
            (error, errors and errors['median']),
        )
        for panel, value in values:
            if value is None:
                continue
            panel.plot(reading['cpu_ms'], value, **how)
            panel.annotate(
                name,
                (reading['cpu_ms'], value),
                (0, 12),
                textcoords='offset points',
                ha='center',
                fontsize=13,
                color=how['color'],
            )
    reach.set_title('How far 80 % are read, 3 cm [m]', fontsize=15)
    reach.set_ylim(0, None)
    error.set_title(f'Median error of range at {COMPARED_AT_M:.0f} m [mm]', fontsize=15)
    error.set_ylim(0, None)
    for panel in (reach, error):
        panel.set_xscale('log')
        panel.margins(x=0.2, y=0.2)
        panel.tick_params(labelsize=12)
        panel.set_xlabel('processor time per second of watching [ms]', fontsize=13)
    figure.savefig(path)
