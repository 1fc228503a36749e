# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw what config/retrolidar.rviz and config/foxglove.json show: viewers.svg beside this file.

A drawing, not a screenshot: panels, topics and cameras are those of the files; zones and markers
are those of the scene `coffee`, projected by these cameras.
"""

from __future__ import annotations

import colorsys
import json
import math
from pathlib import Path
from typing import Any
from xml.sax.saxutils import escape

import numpy as np
import yaml

from retrolidar_ros.scene import Simulation
from retrolidar_ros.scene.description import load_scene
from retrolidar_ros.sensor.frame import Floats

ROOT = Path(__file__).resolve().parents[2]
_WIDTH, _HEIGHT, _GAP = 560, 400, 20
_TITLE, _LINE = 22, 15
_FIELD_OF_VIEW = math.radians(45)
_DEVIATIONS, _ACROSS = 2.0, 0.06  # half axes of a drawn ellipsoid, in deviations, m per metre
_BRIGHT = 100.0  # kcps/SPAD


def _text(x: float, y: float, text: str, fill: str = '#ddd', size: int = 11) -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" fill="{fill}" font-size="{size}">{escape(text)}</text>'


def _panel(box: tuple[float, float, float, float], lines: list[str], fill: str = '#2b2b2b') -> str:
    """Return a panel of x, y, width and height, its title first."""
    x, y, width, height = box
    title, *rest = lines
    size = f'x="{x:.0f}" y="{y:.0f}" width="{width:.0f}" height="{height:.0f}"'
    found = [f'<rect {size} fill="{fill}" stroke="#777"/>', _text(x + 6, y + 15, title, '#fff')]
    found += [_text(x + 6, y + 15 + _LINE * n, one) for n, one in enumerate(rest, start=1)]
    return ''.join(found)


def _scene(box: tuple[float, float, float, float], target_m: Floats, away_m: Floats) -> str:
    """Return zones and markers as an orbiting camera sees them that has z up."""
    x, y, width, height = box
    ahead = -away_m / np.linalg.norm(away_m)
    right = np.cross(ahead, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(ahead, right), ahead])
    scale = height / 2 / math.tan(_FIELD_OF_VIEW / 2)

    def seen(place_m: Floats) -> tuple[float, float, float]:
        across, down, depth = axes @ (place_m - target_m - away_m)
        pixels = scale / depth
        return x + width / 2 + across * pixels, y + height / 2 + down * pixels, pixels

    scene = load_scene('coffee')
    frame = next(iter(Simulation(scene).run(0.1)))
    found, labels = [], []
    rays = np.column_stack([frame.grid.tangents, np.ones(frame.grid.zones)])
    for ray, distance_m, signal in zip(rays, frame.distance, frame.signal, strict=True):
        u, v, _ = seen(ray * float(distance_m))
        hue = 2 / 3 * (1 - min(float(signal) / _BRIGHT, 1.0))
        shade = bytes(round(255 * one) for one in colorsys.hls_to_rgb(hue, 0.55, 0.8)).hex()
        found.append(f'<circle cx="{u:.0f}" cy="{v:.0f}" r="4" fill="#{shade}"/>')
    for marker in scene.markers:
        place_m = np.array(marker.position_m)
        u, v, pixels = seen(place_m)
        range_m = float(np.linalg.norm(place_m))
        radius = _DEVIATIONS * _ACROSS * range_m * pixels
        circle = f'cx="{u:.0f}" cy="{v:.0f}" r="{radius:.0f}"'
        found.append(f'<circle {circle} fill="#009e73" opacity="0.45"/>')
        labels.append(
            _text(u + radius + 3, v - 2, marker.name, '#5fd9b4')
            + _text(u + radius + 3, v + 11, f'{range_m:.3f} m', '#5fd9b4')
        )
    u, v, _ = seen(np.zeros(3))
    found.append(f'<rect x="{u - 5:.0f}" y="{v - 5:.0f}" width="10" height="10" fill="#fff"/>')
    found.append(_text(u + 9, v + 4, 'sensor', '#fff'))
    return ''.join(found + labels)


def _rviz(left: float) -> str:
    config = yaml.safe_load((ROOT / 'config' / 'retrolidar.rviz').read_text(encoding='utf-8'))
    manager = config['Visualization Manager']
    side, bottom = 210.0, 24.0
    view = (left + side, _TITLE, _WIDTH - side, _HEIGHT - bottom)
    lines = ['Displays', 'Fixed Frame', f'    {manager["Global Options"]["Fixed Frame"]}']
    for one in manager['Displays']:
        lines.append(f'☑ {one["Name"]}')
        if 'Topic' in one:
            lines.append(f'    {one["Topic"]["Value"]}')
    camera = manager['Views']['Current']
    pitch, yaw = camera['Pitch'], camera['Yaw']
    away = [math.cos(yaw) * math.cos(pitch), math.sin(yaw) * math.cos(pitch), math.sin(pitch)]
    target_m = np.array([camera['Focal Point'][axis] for axis in 'XYZ'], dtype=float)
    picture = 130.0
    return ''.join(
        [
            _panel((left, _TITLE, side, _HEIGHT - bottom - picture), lines),
            _panel((left, _TITLE + _HEIGHT - bottom - picture, side, picture), ['Signal (image)']),
            _panel(view, [''], '#303030'),
            _scene(view, target_m, camera['Distance'] * np.array(away)),
            _panel((left, _TITLE + _HEIGHT - bottom, _WIDTH, bottom), ['Time']),
        ]
    )


def _content(panel: dict[str, Any], key: str) -> list[str]:
    """Return the title of a panel of Foxglove, and what it shows."""
    kind = key.partition('!')[0]
    title = panel.get(
        'foxglovePanelTitle', {'RawMessages': 'Raw messages'}.get(kind, 'Diagnostics')
    )
    shown = list(panel.get('topics', {})) + [path['value'] for path in panel.get('paths', [])]
    shown += [panel[name] for name in ('topicToRender', 'topicPath') if name in panel]
    if topic := panel.get('imageMode', {}).get('imageTopic'):
        shown.append(topic)
    return [title, *shown]


def _foxglove(left: float) -> str:
    content = json.loads((ROOT / 'config' / 'foxglove.json').read_text(encoding='utf-8'))
    panels, found = content['configById'], []

    def place(layout: Any, box: tuple[float, float, float, float]) -> None:
        x, y, width, height = box
        if isinstance(layout, dict):
            share = layout.get('splitPercentage', 50) / 100
            if layout['direction'] == 'row':
                place(layout['first'], (x, y, share * width, height))
                place(layout['second'], (x + share * width, y, (1 - share) * width, height))
            else:
                place(layout['first'], (x, y, width, share * height))
                place(layout['second'], (x, y + share * height, width, (1 - share) * height))
            return
        panel = panels[layout]
        found.append(_panel(box, _content(panel, layout)))
        if layout.startswith('3D'):
            camera = panel['cameraState']
            phi, theta = math.radians(camera['phi']), -math.radians(camera['thetaOffset'])
            away = [
                math.sin(phi) * math.sin(theta),
                -math.sin(phi) * math.cos(theta),
                math.cos(phi),
            ]
            target_m = np.array(camera['targetOffset'], dtype=float)
            found.append(_scene(box, target_m, camera['distance'] * np.array(away)))

    place(content['layout'], (left, _TITLE, _WIDTH, _HEIGHT))
    return ''.join(found)


def drawing() -> str:
    """Return both layouts as an SVG."""
    width, height = 2 * _WIDTH + _GAP, _TITLE + _HEIGHT
    box = f'viewBox="0 0 {width} {height}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {box} font-family="sans-serif">',
        '<title>Layouts of RViz and Foxglove, drawn from their files</title>',
        f'<rect width="{width}" height="{height}" fill="#fff"/>',
        _text(0, 15, 'RViz (drawn, not a screenshot)', '#222', 13),
        _text(_WIDTH + _GAP, 15, 'Foxglove (drawn, not a screenshot)', '#222', 13),
        _rviz(0.0),
        _foxglove(float(_WIDTH + _GAP)),
        '</svg>',
    ]
    return '\n'.join(parts) + '\n'


if __name__ == '__main__':
    Path(__file__).with_suffix('.svg').write_text(drawing(), encoding='utf-8')
