# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of what was read: the zones with the markers, and each marker's signal and bits."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from retrolidar_ros.detector.blinking_zones import BlinkingZone
from retrolidar_ros.detector.tracks import Track
from retrolidar_ros.marker.code import BIT_PERIOD_S, PREAMBLE, packet
from retrolidar_ros.scene.description import Marker
from retrolidar_ros.scene.truth import Heard
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid

_COLOURS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
_LEGEND: dict[str, Any] = {
    'loc': 'lower right',
    'bbox_to_anchor': (1.0, 1.0),
    'fontsize': 8,
    'frameon': False,
    'borderaxespad': 0.2,
}
_SHOWN_BITS = 66
_GAP_S = 0.1  # of a track
_MOST_SIGNALS, _MOST_UNREAD = 6, 3


class _Shown(NamedTuple):
    """What all parts of the picture show."""

    recording: Recording
    origin_ns: int
    """Time zero of the picture."""
    time_s: Floats
    """Of each frame, shape (frames,)."""
    colours: dict[int, str]
    """Of the zones of interest."""


def _zone_of_interest(axes: Any, grid: ZoneGrid, modulation: Floats) -> None:
    """Draw the zones as seen from the sensor, shaded by how much their signal varies."""
    from matplotlib.colors import LogNorm

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
    for zone, (x, y) in enumerate(grid.tangents - 0.44 * grid.pitch):
        axes.text(x, y, str(zone), fontsize=7, color='0.35', ha='left', va='top')
    degrees = np.array([-20, -10, 0, 10, 20])
    axes.set_xticks(np.tan(np.radians(degrees)), [f'{d}°' for d in degrees])
    axes.set_yticks(np.tan(np.radians(degrees)), [f'{-d}°' for d in degrees])
    axes.set(xlabel='to the right', ylabel='upwards', anchor='S')
    colorbar = axes.figure.colorbar(image, ax=axes, orientation='horizontal', pad=0.02, aspect=30)
    colorbar.set_label('standard deviation of the signal [kcps/SPAD]', fontsize=9)


def _signal(axes: Any, shown: _Shown, zone: int, begin_s: float, end_s: float) -> float:
    """Draw one zone's signal of some seconds; return the height for digits."""
    rows = (shown.time_s >= begin_s) & (shown.time_s <= end_s)
    signal = shown.recording.signal[rows, zone]
    axes.step(shown.time_s[rows], signal, where='mid', color=shown.colours[zone], linewidth=1.1)
    low, high = (float(signal.min()), float(signal.max())) if rows.any() else (0.0, 1.0)
    room = max(high - low, 1.0)
    axes.set_ylim(low - 0.1 * room, high + 0.35 * room)
    axes.set_xlim(begin_s, end_s)
    axes.set_ylabel('kcps/SPAD', fontsize=9)
    return high + 0.2 * room


def _signal_with_bits(axes: Any, shown: _Shown, reading: Heard, name: str) -> None:
    """Draw one zone's signal about a reading, and the bits that were read from it."""
    bit_s, colour = reading.bit_period_s, shown.colours[reading.zone]
    start_s = (reading.start_ns - shown.origin_ns) * 1e-9
    begin_s = max(start_s - 0.4, 0.0)
    height = _signal(axes, shown, reading.zone, begin_s, begin_s + _SHOWN_BITS * bit_s)
    for index, bit in enumerate(packet(reading.id)):
        left = start_s + index * bit_s
        if bit:
            axes.axvspan(left, left + bit_s, color=colour, alpha=0.14, linewidth=0)
        shade = '0.5' if index < len(PREAMBLE) else 'black'
        style = {'ha': 'center', 'va': 'center', 'fontsize': 7, 'clip_on': True}
        axes.text(left + bit_s / 2, height, str(bit), color=shade, **style)
    title = f'{name}, ID {reading.id}, zone {reading.zone}'
    axes.set_title(title, loc='left', fontsize=10, color=colour)


def _blinking_zone(axes: Any, shown: _Shown, zone: BlinkingZone) -> None:
    """Draw the middle of a zone's signal without a reading."""
    middle_s = float(shown.time_s[-1]) / 2
    span_s = _SHOWN_BITS * (zone.bit_period_s if zone.periods else BIT_PERIOD_S)
    _signal(axes, shown, zone.zone, middle_s - span_s / 2, middle_s + span_s / 2)
    bits = f'bits of {1e3 * zone.bit_period_s:.1f} ms' if zone.periods else 'no bit clock'
    title = f'zone {zone.zone} blinks by {zone.modulation_db:.0f} dB, {bits}: not read'
    axes.set_title(title, loc='left', fontsize=10, color=shown.colours[zone.zone])


def _followed(axes: Any, shown: _Shown, tracks: Sequence[Track], marker: int, colour: str) -> None:
    """Draw the range of a marker at every frame, with gaps where it was not followed."""
    own = [one for one in tracks if one.id == marker]
    time_s = np.array([(one.stamp_ns - shown.origin_ns) * 1e-9 for one in own])
    range_m = np.array([one.place.range_m for one in own])
    gaps = np.flatnonzero(np.diff(time_s) > _GAP_S) + 1
    axes.plot(
        np.insert(time_s, gaps, np.nan), np.insert(range_m, gaps, np.nan), color=colour, lw=0.7
    )


def _whole(
    axes: tuple[Any, Any], shown: _Shown, readings: Sequence[Heard], tracks: Sequence[Track]
) -> None:
    """Draw the zones of interest over the whole recording, and the ranges of markers."""
    above, below = axes
    for zone, colour in shown.colours.items():
        signal = shown.recording.signal[:, zone]
        above.plot(shown.time_s, signal, color=colour, linewidth=0.4, label=f'zone {zone}')
    above.set_ylabel('kcps/SPAD', fontsize=9)
    above.set_title('the whole recording', loc='left', fontsize=10)
    above.tick_params(labelbottom=False)
    if shown.colours:
        above.legend(ncols=len(shown.colours), **_LEGEND)
    for identity in dict.fromkeys(one.id for one in readings):
        own = [one for one in readings if one.id == identity]
        read_s = [(one.stamp_ns - shown.origin_ns) * 1e-9 for one in own]
        colour = shown.colours.get(own[0].zone, '0.3')
        ranges_m = [one.range_m for one in own]
        below.plot(read_s, ranges_m, '.', color=colour, label=f'ID {identity}')
        _followed(below, shown, tracks, identity, colour)
    below.set_ylabel('range [m]', fontsize=9)
    below.set_xlabel('time [s]')
    if readings:
        below.margins(y=0.25)
        below.legend(ncols=_MOST_SIGNALS, **_LEGEND)
    else:
        below.text(0.5, 0.5, 'nothing was read', ha='center', transform=below.transAxes)
    for one in axes:
        one.set_xlim(0, max(float(shown.time_s[-1]), 1e-3))


def plot_readings(
    recording: Recording,
    readings: Sequence[Heard],
    path: Path,
    *,
    title: str,
    tracks: Sequence[Track] = (),
    markers: Sequence[Marker] = (),
    blinking: Sequence[BlinkingZone] = (),
) -> None:
    """Write a PNG of a recording, and of the first reading of each marker in it.

    Readings are in order of time. Known `markers` are shown where they really are; where nothing
    was read, so are zones that blink, the strongest first.
    """
    from matplotlib.figure import Figure

    first: dict[int, Heard] = {}
    for reading in readings:
        first.setdefault(reading.id, reading)
    chosen = list(first.values())[:_MOST_SIGNALS]
    unread = [] if chosen else list(blinking[:_MOST_UNREAD])
    zones_shown = dict.fromkeys([one.zone for one in chosen] or [one.zone for one in unread])
    origin_ns = int(recording.stamp_ns[0])
    shown = _Shown(
        recording,
        origin_ns,
        (recording.stamp_ns - origin_ns) * 1e-9,
        {zone: _COLOURS[index % len(_COLOURS)] for index, zone in enumerate(zones_shown)},
    )
    rows = max(len(chosen), len(unread), 2)
    figure = Figure(figsize=(13, 4.4 + 1.75 * rows), layout='constrained')
    figure.suptitle(title, fontsize=13)
    heights = [1.75] * rows + [1.6, 1.6]
    spaces = figure.add_gridspec(rows + 2, 2, width_ratios=(1, 1.9), height_ratios=heights)
    zones = figure.add_subplot(spaces[:rows, 0])
    _zone_of_interest(zones, recording.grid, recording.signal.std(axis=0).astype(np.float64))
    above = figure.add_subplot(spaces[rows, :])
    _whole((above, figure.add_subplot(spaces[rows + 1, :], sharex=above)), shown, readings, tracks)
    for marker in markers:
        x, y, z = marker.position_m
        zones.plot(x / z, y / z, marker='s', markersize=9, fillstyle='none', color='black')
        label = zones.annotate(
            marker.name, (x / z, y / z), (0, 9), textcoords='offset points', ha='center', fontsize=9
        )
        label.set_bbox({'facecolor': 'white', 'alpha': 0.8, 'edgecolor': 'none', 'pad': 1})
    names = {marker.id: marker.name for marker in markers}
    for index, reading in enumerate(chosen):
        x, y, z = reading.position_m
        colour = shown.colours[reading.zone]
        zones.plot(x / z, y / z, marker='x', markersize=9, markeredgewidth=2, color=colour)
        name = names.get(reading.id, 'ghost' if names else 'marker')
        _signal_with_bits(figure.add_subplot(spaces[index, 1]), shown, reading, name)
    for index, zone in enumerate(unread):
        _blinking_zone(figure.add_subplot(spaces[index, 1]), shown, zone)
    if chosen and markers:
        zones.set_title('square: marker, cross: read', fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
