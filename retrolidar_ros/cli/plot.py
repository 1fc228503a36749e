# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of what was read: the zones with the markers, and each marker's signal and bits."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any, NamedTuple

import numpy as np

from retrolidar_ros.bag import salvage_frames
from retrolidar_ros.cli.arguments import add_bag, add_detector_options, detector_values, output_path
from retrolidar_ros.cli.decode import NOTHING_READ, print_hints
from retrolidar_ros.detector import Detection
from retrolidar_ros.detector.blinking_zones import BlinkingZone
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.detection import Track
from retrolidar_ros.marker.code import BIT_PERIOD_S, PREAMBLE, packet
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.optics import position_at
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid

HELP = 'draw what was read in a bag'
_COLOURS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
_LEGEND: dict[str, Any] = {
    'loc': 'lower right',
    'bbox_to_anchor': (1.0, 1.0),
    'fontsize': 8,
    'frameon': False,
    'borderaxespad': 0.2,
}
_SHOWN_BITS = 66
_MAX_SIGNALS, _MAX_UNREAD, _MAX_READINGS = 6, 3, 100
_HINT_WIDTH = 150  # characters
_ALONG = 400  # points of a marker's way


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_bag(command)
    add_detector_options(command)
    command.add_argument(
        '-o', '--output', type=output_path, required=True, help='PNG file to write'
    )


def run(arguments: argparse.Namespace) -> int:
    """Draw a bag, as far as it can be read."""
    if arguments.output.is_dir():
        raise IsADirectoryError(f'{arguments.output} is a directory; name a PNG file')
    frames, damage = salvage_frames(arguments.bag, arguments.topic)
    decoding = Decoding(detector_values(arguments))
    readings: list[Detection] = []
    tracks: list[Track] = []
    for detections, followed in decoding.steps(frames, follow=True):
        readings += detections
        tracks += followed
    explanation = decoding.explanation()
    hints = print_hints(decoding, explanation)
    plot_readings(
        Recording.of(frames),
        readings,
        arguments.output,
        tracks=tracks,
        title=f'{arguments.bag.name}: {len(frames)} frames, {len(readings)} readings',
        hint=str(hints[0]) if hints else '',
        blinking=() if readings else explanation.zones,
    )
    print(f'{arguments.output}: {len(frames)} frames, {len(readings)} readings')
    if damage is not None:
        raise damage
    return 0 if readings else NOTHING_READ


class _Shown(NamedTuple):
    """What all parts of the picture show."""

    recording: Recording
    origin_ns: int  # time zero of the picture
    time_s: Floats  # of each frame, shape (frames,)
    ids: dict[int, str]  # colours of markers
    zones: dict[int, str]  # colours of zones of interest


def _zone_map(axes: Any, grid: ZoneGrid, modulation: Floats) -> None:
    from matplotlib.colors import LogNorm
    from matplotlib.patheffects import withStroke

    half = grid.pitch * grid.columns / 2
    image = axes.imshow(
        modulation.reshape(grid.rows, grid.columns),
        extent=(-half, half, half, -half),
        cmap='Greys',
        norm=LogNorm(max(float(modulation.min()), 0.1), max(float(modulation.max()) * 3, 1.0)),
    )
    edges = grid.pitch * (np.arange(grid.columns + 1) - grid.columns / 2)
    axes.hlines(edges, -half, half, colors='0.6', linewidth=0.6)
    axes.vlines(edges, -half, half, colors='0.6', linewidth=0.6)
    halo = [withStroke(linewidth=2, foreground='white')]
    for zone, (x, y) in enumerate(grid.tangents - 0.44 * grid.pitch):
        axes.text(x, y, str(zone), fontsize=8, ha='left', va='top', path_effects=halo, zorder=4)
    degrees = np.array([-20, -10, 0, 10, 20])
    axes.set_xticks(np.tan(np.radians(degrees)), [f'{d}°' for d in degrees])
    axes.set_yticks(np.tan(np.radians(degrees)), [f'{-d}°' for d in degrees])
    axes.set(xlabel='to the right', ylabel='upwards', anchor='N')
    bar = axes.figure.colorbar(image, ax=axes, orientation='horizontal', shrink=0.8)
    bar.set_label('standard deviation of the signal [kcps/SPAD]', fontsize=9)


def _places(
    axes: Any, shown: _Shown, readings: Sequence[Detection], markers: Sequence[Marker]
) -> None:
    """Draw where markers are, and where they were read; what moves is a line."""
    time_s = np.linspace(0, shown.time_s[-1], _ALONG)
    for marker in markers:
        x, y, z = position_at(marker, time_s).T
        axes.plot(x / z, y / z, color='black', linewidth=0.8)
        axes.plot(x[0] / z[0], y[0] / z[0], 's', markersize=9, fillstyle='none', color='black')
        place = (x[0] / z[0], y[0] / z[0])
        style = {'textcoords': 'offset points', 'ha': 'center', 'fontsize': 9}
        label = axes.annotate(marker.name, place, (0, 9), **style)
        label.set_bbox({'facecolor': 'white', 'alpha': 0.8, 'edgecolor': 'none', 'pad': 1})
    for index, (identity, colour) in enumerate(shown.ids.items()):
        x, y, z = np.array([one.place.position_m for one in readings if one.id == identity]).T
        axes.plot(x / z, y / z, color=colour, linewidth=1)
        style = {'markersize': 9, 'markeredgewidth': 2, 'color': colour}
        axes.plot(x[0] / z[0], y[0] / z[0], 'x+'[index % 2], **style)
    if readings and markers:
        motion = '; lines: motion' if any(one.wander or one.path for one in markers) else ''
        axes.set_title(f'square: marker, cross: read{motion}', fontsize=10)


def _signal(
    axes: Any, shown: _Shown, zone: int, begin_s: float, end_s: float, colour: str, title: str
) -> float:
    """Draw one zone's signal of some seconds; return the height for digits."""
    axes.set_title(title, loc='left', fontsize=10, color=colour)
    rows = (shown.time_s >= begin_s) & (shown.time_s <= end_s)
    signal = shown.recording.signal[rows, zone]
    axes.step(shown.time_s[rows], signal, where='mid', color=colour, linewidth=1.1)
    low, high = (float(signal.min()), float(signal.max())) if rows.any() else (0.0, 1.0)
    room = max(high - low, 1.0)
    axes.set_ylim(low - 0.1 * room, high + 0.35 * room)
    axes.set_xlim(begin_s, end_s)
    axes.set_ylabel('kcps/SPAD', fontsize=9)
    return high + 0.2 * room


def _signal_with_bits(axes: Any, shown: _Shown, reading: Detection, name: str) -> None:
    """Draw a zone's signal about a reading, and its bits, those before it as they repeat."""
    bit_s, colour = reading.bit_period_s, shown.ids[reading.id]
    start_s = (reading.start_ns - shown.origin_ns) * 1e-9
    begin_s = min(max(start_s - 0.4, 0.0), start_s)
    zone, end_s = reading.zones[0], begin_s + _SHOWN_BITS * bit_s
    title = f'{name}, ID {reading.id}, zone {zone}'
    height = _signal(axes, shown, zone, begin_s, end_s, colour, title)
    bits = packet(reading.id)
    known = max(round((reading.end_ns - reading.start_ns) * 1e-9 / bit_s), len(bits))
    for index in range(min(known, _SHOWN_BITS)):
        left, bit = start_s + index * bit_s, bits[index % len(bits)]
        was_seen = left + bit_s > 0
        if bit and was_seen:
            axes.axvspan(left, left + bit_s, color=colour, alpha=0.14, linewidth=0)
        shade = '0.5' if index % len(bits) < len(PREAMBLE) or not was_seen else 'black'
        style = {'ha': 'center', 'va': 'center', 'fontsize': 7, 'clip_on': True}
        axes.text(left + bit_s / 2, height, str(bit), color=shade, **style)
    if begin_s < 0:
        axes.axvspan(begin_s, 0, color='0.92', linewidth=0)


def _signals(axes: Any, shown: _Shown) -> None:
    drawn: list[str] = []
    for zone, colour in shown.zones.items():
        signal = shown.recording.signal[:, zone]
        # A marker that moves has its colour in several zones.
        alpha = 0.45 ** drawn.count(colour)
        how: dict[str, Any] = {'color': colour, 'linewidth': 0.4, 'alpha': alpha}
        axes.plot(shown.time_s, signal, label=f'zone {zone}', **how)
        drawn.append(colour)
    axes.set_ylabel('kcps/SPAD', fontsize=9)
    axes.set_title('the whole recording', loc='left', fontsize=10)
    axes.set_xlim(0, max(float(shown.time_s[-1]), 1e-3))
    axes.legend(ncols=len(shown.zones), **_LEGEND)


def _every_zone(figure: Any, place: Any, shown: _Shown) -> None:
    grid, first = shown.recording.grid, None
    for zone, part in enumerate(place.subgridspec(grid.rows, grid.columns)):
        axes = figure.add_subplot(part, sharex=first, sharey=first)
        first = first or axes
        axes.plot(shown.time_s, shown.recording.signal[:, zone], color=_COLOURS[0], linewidth=0.4)
        axes.set_title(str(zone), loc='left', fontsize=8, pad=1)
        axes.tick_params(labelsize=7)
        axes.set_xlabel('time [s]', fontsize=8)
        axes.set_ylabel('kcps/SPAD', fontsize=8)
        axes.label_outer()


def _ranges(
    axes: Any, shown: _Shown, readings: Sequence[Detection], tracks: Sequence[Track]
) -> None:
    for identity, colour in shown.ids.items():
        own = [one for one in readings if one.id == identity]
        read_s = [(one.stamp_ns - shown.origin_ns) * 1e-9 for one in own]
        axes.plot(
            read_s, [one.place.range_m for one in own], '.', color=colour, label=f'ID {identity}'
        )
        followed = [one for one in tracks if one.id == identity]
        followed_s = [(one.stamp_ns - shown.origin_ns) * 1e-9 for one in followed]
        axes.plot(followed_s, [one.place.range_m for one in followed], ',', color=colour)
    axes.set_ylabel('range [m]', fontsize=9)
    axes.set_xlabel('time [s]')
    axes.margins(y=0.25)
    axes.legend(ncols=_MAX_SIGNALS, **_LEGEND)


def plot_readings(
    recording: Recording,
    readings: Sequence[Detection],
    path: Path,
    *,
    title: str,
    hint: str = '',
    tracks: Sequence[Track] = (),
    markers: Sequence[Marker] = (),
    blinking: Sequence[BlinkingZone] = (),
) -> None:
    """Write a PNG of a recording, and of the first reading of each marker in it.

    Where nothing was read, the zones that blink most are shown, or all; a `hint` says what to do.
    """
    from matplotlib.figure import Figure

    first: dict[int, Detection] = {}
    for reading in readings:
        first.setdefault(reading.id, reading)
    chosen = list(first.values())[:_MAX_SIGNALS]
    unread = [] if chosen else list(blinking[:_MAX_UNREAD])
    origin_ns = int(recording.stamp_ns[0])
    ids = {one.id: _COLOURS[index % len(_COLOURS)] for index, one in enumerate(chosen)}
    zones = {one.zone: _COLOURS[index] for index, one in enumerate(unread)}
    for reading in readings[: _MAX_READINGS if chosen else 0]:
        if reading.id in ids:
            zones.setdefault(reading.zones[0], ids[reading.id])
    time_s = (recording.stamp_ns - origin_ns) * 1e-9
    shown = _Shown(recording, origin_ns, time_s, ids, zones)
    rows = max(len(chosen), len(unread), 3)
    below = [1.6] * (bool(zones) + bool(chosen))
    figure = Figure(figsize=(13, 1.2 + 1.9 * rows + sum(below)), layout='constrained')
    figure.suptitle('\n'.join([title, *([fill(hint, _HINT_WIDTH)] if hint else [])]), fontsize=11)
    heights = [1.9] * rows + below
    spaces = figure.add_gridspec(len(heights), 2, width_ratios=(1, 1.9), height_ratios=heights)
    here = figure.add_subplot(spaces[:rows, 0])
    _zone_map(here, recording.grid, recording.signal.std(axis=0).astype(np.float64))
    _places(here, shown, readings, markers)
    names = {marker.id: marker.name for marker in markers}
    right = spaces[:rows, 1]
    parts = right.subgridspec(max(len(chosen), len(unread), 1), 1)
    for index, reading in enumerate(chosen):
        name = names.get(reading.id, 'ghost' if names else 'marker')
        _signal_with_bits(figure.add_subplot(parts[index, 0]), shown, reading, name)
    middle_s, half_s = float(time_s[-1]) / 2, _SHOWN_BITS * BIT_PERIOD_S / 2
    for index, (zone, decibels, *_) in enumerate(unread):
        axes = figure.add_subplot(parts[index, 0])
        title = f'zone {zone} blinks by {decibels:.0f} dB: not read'
        _signal(axes, shown, zone, middle_s - half_s, middle_s + half_s, zones[zone], title)
    if not chosen and not unread:
        _every_zone(figure, right, shown)
    if zones:
        above = figure.add_subplot(spaces[rows, :])
        _signals(above, shown)
        if chosen:
            above.tick_params(labelbottom=False)
            _ranges(figure.add_subplot(spaces[rows + 1, :], sharex=above), shown, readings, tracks)
        else:
            above.set_xlabel('time [s]')
    figure.savefig(path, dpi=110)
