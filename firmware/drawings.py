# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw the wiring, the stack and the timing of docs/hardware.md.

Pins and times come from the sketches, and light and packet from the package, so that a drawing
cannot say anything else. Run it in the root of the repository, as `python3 firmware/drawings.py`.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Polygon, Rectangle

FIRMWARE = Path(__file__).resolve().parent
sys.path.insert(0, str(FIRMWARE.parent))  # without ROS, the package is not installed

from retrolidar_ros.marker.code import packet  # noqa: E402
from retrolidar_ros.marker.liquid_crystal import Response  # noqa: E402

IMAGES = FIRMWARE.parent / 'docs' / 'images'
DPI = 130
INK, QUIET, SIGNAL, POWER, LIGHT = '#1b1f24', '#57606a', '#0b5cad', '#b03a2e', '#b7791f'
FILL, MARK = '#f3f5f7', '#dce9f7'


class Box(NamedTuple):
    """A part, by its lower left corner and its size."""

    x: float
    y: float
    width: float
    height: float

    def side(self, name: str, share: float = 0.5) -> tuple[float, float]:
        """Return a point on a side, at a share of it from below or from the left."""
        if name in ('left', 'right'):
            return self.x + self.width * (name == 'right'), self.y + self.height * share
        return self.x + self.width * share, self.y + self.height * (name == 'top')


def pins(sketch: str) -> dict[str, str]:
    """Return the pins that a sketch uses, by what they are for."""
    text = (FIRMWARE / sketch / f'{sketch}.ino').read_text(encoding='utf-8')
    return dict(re.findall(r'(\w+)_PIN = (\w+)', text))


def constant(sketch: str, name: str) -> int:
    """Return a whole number that a sketch sets, that for 4x4 zones if it depends on them."""
    text = (FIRMWARE / sketch / f'{sketch}.ino').read_text(encoding='utf-8')
    found = re.search(rf'{name} = (?:ROWS == 4 \? )?(\d+)', text)
    if found is None:
        raise ValueError(f'{sketch}.ino sets no {name}')
    return int(found[1])


def sheet(width: float, height: float) -> tuple[Figure, Axes]:
    """Return an empty drawing whose coordinates are inches."""
    figure = Figure(figsize=(width, height))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(0, height))
    axes.axis('off')
    return figure, axes


def put(axes: Axes, box: Box, title: str, text: str = '', color: str = FILL) -> Box:
    """Draw a part with its name and a line or two about it."""
    axes.add_patch(
        FancyBboxPatch(
            (box.x, box.y),
            box.width,
            box.height,
            boxstyle='round,pad=0,rounding_size=0.06',
            facecolor=color,
            edgecolor=INK,
            linewidth=1.2,
        )
    )
    x, y = box.side('top')
    lines = title.count('\n') + 1
    axes.text(x, y - 0.08, title, ha='center', va='top', fontsize=10, weight='bold', color=INK)
    axes.text(x, y - 0.12 - 0.19 * lines, text, ha='center', va='top', fontsize=9, color=QUIET)
    return box


def join(
    axes: Axes,
    start: tuple[float, float],
    end: tuple[float, float],
    label: str = '',
    color: str = SIGNAL,
    style: str = '-|>',
) -> None:
    """Draw a wire with its label above the middle, or beside it if it is upright."""
    axes.annotate(
        '', end, start, arrowprops={'arrowstyle': style, 'color': color, 'linewidth': 1.4}
    )
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    if abs(start[0] - end[0]) < abs(start[1] - end[1]):
        axes.text(x + 0.07, y, label, ha='left', va='center', fontsize=9, color=color)
    else:
        axes.text(x, y + 0.03, label, ha='center', va='bottom', fontsize=9, color=color)


def draw_reader(path: Path) -> None:
    """Draw what is between the sensor and the computer."""
    figure, axes = sheet(8.6, 2.75)
    pin = pins('reader')
    sensor = put(
        axes, Box(0.2, 0.35, 2.1, 2.1), 'X-NUCLEO-53L8A1', 'VL53L8CX\n\njumpers J7, J8, J9\non SPI'
    )
    board = put(axes, Box(4.1, 0.35, 2.0, 2.1), 'NUCLEO-F401RE', '')
    wires = (
        ('CLOCK', 'SPI clock', '<|-'),
        ('MOSI', 'SPI MOSI', '<|-'),
        ('MISO', 'SPI MISO', '-|>'),
        ('SELECT', 'SPI select', '<|-'),
        ('POWER', 'power enable', '<|-'),
        ('LPN', 'enable (LPn)', '<|-'),
        ('INTERRUPT', 'frame ready', '-|>'),
    )
    for row, (name, label, style) in enumerate(wires):
        share = 0.79 - 0.121 * row
        color = POWER if name in ('POWER', 'LPN') else SIGNAL
        join(axes, sensor.side('right', share), board.side('left', share), label, color, style)
        x, y = board.side('left', share)
        axes.text(x + 0.08, y, pin[name], va='center', fontsize=9, weight='bold', color=color)
    x, y = board.side('right', 0.42)
    axes.text(x - 0.1, y, 'ST-LINK', ha='right', va='center', fontsize=9, color=QUIET)
    computer = put(axes, Box(7.1, 0.75, 1.3, 1.3), 'Robot', '/dev/ttyACM0')
    join(axes, (x, 1.4), computer.side('left'), 'USB', SIGNAL, '<|-|>')
    figure.savefig(path, dpi=DPI)


def draw_marker(path: Path) -> None:
    """Draw what is between the light, the processor and the liquid crystal."""
    figure, axes = sheet(8.6, 4.6)
    pin = pins('marker')
    width, gap, top = 1.22, 0.24, 3.15
    chain = (
        ('Photodiode', 'behind a\n940 nm filter'),
        ('Amplifier', 'OPA320\n2 MΩ, 3 pF'),
        ('High-pass', 'two RC\nin series'),
        ('Amplifier', 'OPA320'),
        ('Rectifier', 'SMS7630\n-079LF'),
    )
    last = None
    for place, (title, text) in enumerate(chain):
        box = put(axes, Box(0.2 + place * (width + gap), top, width, 0.95), title, text)
        if last is not None:
            join(axes, last.side('right'), box.side('left'))
        last = box
    assert last is not None
    compare = put(axes, Box(7.5, top, 0.95, 0.95), 'Com-\nparator')
    join(axes, last.side('right'), compare.side('left'))
    join(axes, (0.81, 4.55), (0.81, top + 0.95), "the sensor's light", LIGHT)

    processor = put(axes, Box(4.3, 0.45, 2.3, 1.75), 'NUCLEO-L031K6', 'or another STM32', MARK)
    x, y = compare.side('bottom', 0.25)
    axes.plot([x, x], [y, 1.6], color=SIGNAL, linewidth=1.4)
    join(axes, (x, 1.6), processor.side('right', (1.6 - 0.45) / 1.75))
    axes.text(
        6.5, 1.6, pin['LIGHT'], ha='right', va='center', fontsize=9, weight='bold', color=SIGNAL
    )
    axes.text(7.05, 1.63, 'light', ha='center', va='bottom', fontsize=9, color=SIGNAL)

    start = processor.side('top', 0.12)
    join(axes, start, (start[0], top - 0.2), f'{pin["FRONTEND"]}: power while looking', POWER)
    axes.plot([0.2, 8.45], [top - 0.2] * 2, color=POWER, linewidth=1.4)
    for box_x in (0.31 + 1 * (width + gap), 0.31 + 3 * (width + gap), 7.7):
        join(axes, (box_x + 0.5, top - 0.2), (box_x + 0.5, top), '', POWER)

    driver = put(
        axes,
        Box(2.3, 0.45, 1.15, 1.75),
        'Driver',
        'two gates\nof 5 V, such\nas 74AHCT\n\npull-downs',
    )
    axes.text(2.875, 0.12, '5 V, GND', ha='center', va='center', fontsize=9, color=POWER)
    join(axes, (2.875, 0.2), driver.side('bottom'), '', POWER)
    axes.text(5.45, 0.12, '3.3 V, GND', ha='center', va='center', fontsize=9, color=POWER)
    join(axes, (5.45, 0.2), processor.side('bottom'), '', POWER)
    crystal = put(axes, Box(0.2, 0.45, 1.2, 1.75), 'Liquid\ncrystal', 'electrodes')
    for name, label, share in (('FIRST', 'first', 0.55), ('SECOND', 'second', 0.2)):
        join(axes, processor.side('left', share), driver.side('right', share), label)
        join(axes, driver.side('left', share), crystal.side('right', share), '0 or 5 V')
        x, y = processor.side('left', share)
        axes.text(x + 0.08, y, pin[name], va='center', fontsize=9, weight='bold', color=SIGNAL)
    join(
        axes, (8.45, 0.8), processor.side('right', 0.2), 'USB: the ID is set here', SIGNAL, '<|-|>'
    )
    figure.savefig(path, dpi=DPI)


def draw_stack(path: Path) -> None:
    """Draw the layers of a marker, and what becomes of light in them."""
    figure, axes = sheet(8.6, 2.9)
    layers = (
        ('polariser', 0.14, '#9aa7b4'),
        ('liquid crystal\n(twisted by 90°)', 0.5, '#cfe3f5'),
        ('polariser,\ncrossed', 0.14, '#9aa7b4'),
        ('retroreflector', 0.45, '#e9dfc6'),
    )
    for left, title, volts, passed in (
        (0.55, 'bright: 0 V', '0 V', True),
        (4.85, 'dark: 5 V, one way and the other in turn', '±5 V', False),
    ):
        axes.text(left + 1.75, 2.72, title, ha='center', va='top', fontsize=10, weight='bold')
        x = left + 0.75
        centres = []
        for index, (name, thickness, color) in enumerate(layers):
            axes.add_patch(Rectangle((x, 0.75), thickness, 1.55, facecolor=color, edgecolor=INK))
            centres.append(x + thickness / 2)
            drop = 0.68 if index % 2 == 0 else 0.33
            axes.text(centres[-1], drop, name, ha='center', va='top', fontsize=9, color=INK)
            x += thickness + 0.3
        back = x - 0.3 - layers[-1][1]
        for notch in range(5):
            y = 0.75 + 0.31 * notch
            axes.add_patch(
                Polygon([(back, y), (back, y + 0.31), (back + 0.2, y + 0.155)], color='white')
            )
        axes.text(centres[1], 2.18, volts, ha='center', va='top', fontsize=9, color=SIGNAL)
        end = back + 0.1 if passed else centres[2] - 0.07
        join(axes, (left - 0.35, 1.72), (end, 1.72), '', LIGHT)
        if passed:
            join(axes, (end, 1.4), (left - 0.35, 1.4), '', LIGHT)
    figure.savefig(path, dpi=DPI)


def draw_timing(path: Path) -> None:
    """Draw the end of a preamble: electrodes, light and the sensor's frames."""
    bit_s, half_s = (constant('marker', name) * 1e-6 for name in ('BIT_US', 'HALF_PERIOD_US'))
    bits = packet(2073)[:5].astype(float)
    response = Response()
    time_s = np.arange(0, len(bits) * bit_s, 1e-4)
    place = (time_s / bit_s).astype(int)
    light = np.ones_like(time_s)
    for index in range(len(bits)):
        inside = place == index
        before = 1 - bits[index - 1] if index else 1.0
        levels = np.full(inside.sum(), 1 - bits[index])
        elapsed = time_s[inside] - index * bit_s
        light[inside] = response.relaxation(np.full(inside.sum(), before), levels, elapsed)[1]
    wave = np.where((time_s / half_s).astype(int) % 2 == 0, 5.0, -5.0) * bits[place]

    figure = Figure(figsize=(8.6, 3.6), layout='constrained')
    volts, seen = figure.subplots(2, sharex=True)
    volts.plot(time_s * 1e3, wave, color=SIGNAL, linewidth=0.6)
    volts.set_ylabel('between the\nelectrodes [V]')
    volts.set_ylim(-7, 9.5)
    for index, bit in enumerate(bits):
        volts.text((index + 0.5) * bit_s * 1e3, 6.3, f'bit {bit:.0f}', ha='center', fontsize=9)
    seen.plot(time_s * 1e3, light, color=LIGHT, linewidth=1.6)
    seen.set_ylabel('light passed')
    seen.set_ylim(-0.45, 1.12)
    frame_s = 1 / constant('reader', 'RATE_HZ')
    for index in range(int(len(bits) * bit_s / frame_s)):
        start_ms = (0.004 + index * frame_s) * 1e3
        seen.barh(-0.25, frame_s * 1e3 - 0.8, 0.16, start_ms, color=MARK, edgecolor=INK)
    seen.text(-1.0, -0.25, 'frames', ha='right', va='center', fontsize=9, color=QUIET)
    seen.set_xlim(-20, None)
    seen.set_yticks([0, 1])
    seen.set_xlabel('time [ms]')
    for axis in (volts, seen):
        axis.set_xticks(np.arange(len(bits) + 1) * bit_s * 1e3)
        axis.grid(axis='x', color='#d0d7de')
        axis.spines[['top', 'right']].set_visible(False)
    figure.savefig(path, dpi=DPI)


DRAWINGS = {
    'hardware_reader.png': draw_reader,
    'hardware_marker.png': draw_marker,
    'hardware_stack.png': draw_stack,
    'hardware_timing.png': draw_timing,
}


def main(directory: Path = IMAGES) -> None:
    """Make all drawings."""
    for name, draw in DRAWINGS.items():
        draw(directory / name)


if __name__ == '__main__':
    main()
