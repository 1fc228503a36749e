# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw what the whole is, from marker to message: overview.svg beside this file."""

from __future__ import annotations

import colorsys
from pathlib import Path
from xml.sax.saxutils import escape

from retrolidar_ros.marker.code import packet

_WIDTH, _HEIGHT = 830, 300
_MONO = 'DejaVu Sans Mono, monospace'
_INK, _GREY, _PANEL = '#1b1f24', '#57606a', '#f3f5f7'
_LIGHT, _LIT = '#f0b429', '#cfe3f5'
_ID, _SHOWN_BITS, _BIT = 2096, 16, 11
_MESSAGE = ('id: 2096', 'range: 1.98 m', 'position: x, y, z', 'covariance', 'bits, evidence')


def _named(**attributes: str) -> str:
    return ' '.join(f'{name.replace("_", "-")}="{value}"' for name, value in attributes.items())


def _text(x: float, y: float, text: str, size: float = 14, **more: str) -> str:
    how = _named(**{'fill': _INK, 'font_size': f'{size:g}'} | more)
    return f'<text x="{x:g}" y="{y:g}" {how}>{escape(text)}</text>'


def _box(x: float, y: float, width: float, height: float, fill: str = _PANEL, **more: str) -> str:
    size = f'x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"'
    return f'<rect {size} {_named(**{"fill": fill, "stroke": _INK} | more)}/>'


def _line(points: str, **more: str) -> str:
    how = {'stroke': _INK, 'fill': 'none', 'stroke_width': '1.5'} | more
    return f'<path d="{points}" {_named(**how)}/>'


def _marker() -> list[str]:
    """Return the marker: a retroreflector behind a liquid crystal, and the bits it shows."""
    found = [_text(14, 26, 'marker', 16, font_weight='bold')]
    found.append(_box(66, 58, 14, 92, '#e9dfc6'))
    found += [_line(f'M80 {y} l-11 9 l11 9', fill='#fff') for y in range(62, 145, 21)]
    found.append(_box(94, 58, 12, 92, _LIT))
    found.append(_line('M54 58 V150 M49 58 H59 M49 150 H59', stroke=_GREY))
    found.append(_text(48, 109, '3 cm', 13, fill=_GREY, text_anchor='end'))
    found.append(_text(14, 176, 'retroreflector behind', 13, fill=_GREY))
    found.append(_text(14, 193, 'a liquid crystal', 13, fill=_GREY))
    bits = packet(_ID)[:_SHOWN_BITS]
    for index, bit in enumerate(bits):
        shade = '#3b4a5a' if bit else _LIT
        found.append(_box(14 + _BIT * index, 218, _BIT, 20, shade, stroke_width='0.5'))
    found.append(_text(14 + _BIT * _SHOWN_BITS + 5, 234, '…', 14, fill=_GREY))
    found.append(_text(14, 260, 'blinks one of 4094 IDs', 13, fill=_GREY))
    found.append(_text(14, 277, 'in 1.3 s, bright and dark', 13, fill=_GREY))
    return found


def _sensor() -> list[str]:
    """Return the sensor's view of 4x4 zones and its light, which comes back from the marker."""
    left, top, zone = 250.0, 58.0, 23.0
    grid = left + 64
    found = [_text(left, 26, 'sensor', 16, font_weight='bold')]
    found.append(
        _line(f'M{left + 32:g} 104 L{grid:g} {top:g} V{top + 4 * zone:g} Z', fill='#eef1f4')
    )
    signals = (2, 2, 2, 2, 2, 5, 3, 2, 3, 9, 4, 2, 2, 3, 2, 2)
    for index, signal in enumerate(signals):
        row, column = divmod(index, 4)
        red_green_blue = colorsys.hls_to_rgb(42 / 360, 0.96 - 0.05 * signal, 0.85)
        shade = '#' + bytes(round(255 * one) for one in red_green_blue).hex()
        found.append(_box(grid + zone * column, top + zone * row, zone, zone, shade))
    found.append(_box(left, 88, 32, 32, '#3b4a5a', rx='3'))
    found += [f'<circle cx="{left + 16:g}" cy="{y}" r="4" fill="{_LIGHT}"/>' for y in (97, 111)]
    there, back = f'M{left - 6:g} 97 H122', f'M116 111 H{left - 12:g}'
    found += [
        _line(one, stroke=_LIGHT, stroke_width='3', marker_end='url(#a)') for one in (there, back)
    ]
    found.append(_text(180, 86, 'infrared light', 13, fill=_GREY, text_anchor='middle'))
    found.append(_text(180, 134, 'there and back', 13, fill=_GREY, text_anchor='middle'))
    found.append(_text(left, 176, 'VL53L8CX: time of flight,', 13, fill=_GREY))
    found.append(_text(left, 193, '4×4 zones, a frame each 21 ms', 13, fill=_GREY))
    found.append(_text(left, 234, 'its own light: in the dark, too;', 13, fill=_GREY))
    found.append(_text(left, 251, 'no picture is taken', 13, fill=_GREY))
    return found


def _robot() -> list[str]:
    """Return the two nodes on the robot, and what they publish."""
    left = 484
    found = [_text(left, 26, 'robot, ROS 2', 16, font_weight='bold')]
    found.append(_line(f'M416 104 H{left - 8}', marker_end='url(#b)'))
    found.append(_text(430, 96, 'USB', 13, fill=_GREY))
    for y, name in ((58, 'driver'), (112, 'detector')):
        found.append(_box(left, y, 96, 38, rx='5'))
        found.append(_text(left + 48, y + 24, name, 15, text_anchor='middle'))
    found.append(_line(f'M{left + 48} 96 V106', marker_end='url(#b)'))
    found.append(_line(f'M{left + 96} 131 H{left + 126}', marker_end='url(#b)'))
    found.append(_text(left, 176, 'or without ROS:', 13, fill=_GREY))
    found.append(_text(left, 193, 'retrolidar decode', 11.5, fill=_GREY, font_family=_MONO))
    right = left + 134
    found.append(_text(right, 26, 'what comes out', 16, font_weight='bold'))
    found.append(_box(right, 58, 200, 130, '#fff', rx='5'))
    found.append(_text(right + 10, 78, 'MarkerDetection', 14, font_weight='bold'))
    found += [
        _text(right + 10, 98 + 19 * index, line, 13, font_family=_MONO)
        for index, line in enumerate(_MESSAGE)
    ]
    x, y = right + 20, 262
    for dx, dy, colour in ((26, 0, '#c0392b'), (0, -26, '#2e7d32'), (-15, 13, '#1565c0')):
        found.append(_line(f'M{x} {y} l{dx} {dy}', stroke=colour, stroke_width='3'))
    found.append(_text(right + 56, 234, 'TF frame', 14, font_weight='bold'))
    found.append(_text(right + 56, 253, 'marker_2096', 13, font_family=_MONO))
    found.append(_text(right + 56, 270, 'for a packet, or for every', 12))
    found.append(_text(right + 56, 287, 'frame (MarkerTrack)', 12))
    return found


def drawing() -> str:
    """Return the picture as an SVG."""
    arrow = (
        '<marker id="{}" viewBox="0 0 8 8" refX="5" refY="4" markerWidth="{}" markerHeight="{}" '
        'orient="auto"><path d="M0 0 L8 4 L0 8 Z" fill="{}"/></marker>'
    )
    fonts = 'DejaVu Sans, Verdana, Helvetica, Arial, sans-serif'
    box = f'viewBox="0 0 {_WIDTH} {_HEIGHT}"'
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" {box} font-family="{fonts}">',
        '<title>A blinking marker, a time-of-flight sensor, a robot, and what comes out</title>',
        f'<defs>{arrow.format("a", 4, 4, _LIGHT)}{arrow.format("b", 6, 6, _INK)}</defs>',
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="#fff"/>',
        *_marker(),
        *_sensor(),
        *_robot(),
        '</svg>',
    ]
    return '\n'.join(parts) + '\n'


if __name__ == '__main__':
    Path(__file__).with_suffix('.svg').write_text(drawing(), encoding='utf-8')
