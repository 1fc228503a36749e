# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""A picture of what was read: the zones with the markers, and each marker's signal and bits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.detector import Detection
from retrolidar_ros.marker.code import BIT_PERIOD_S, PREAMBLE, packet
from retrolidar_ros.sensor.frame import Floats, Recording, ZoneGrid

_COLOURS = ('#0072b2', '#d55e00', '#009e73', '#cc79a7', '#e69f00', '#56b4e9')
_SHOWN_S = 2.8
_MOST_SIGNALS = 6


class Reading(NamedTuple):
    """What the picture needs of a detection."""

    id: int
    name: str
    start_s: float
    """On the clock of the recording's stamps."""
    position_m: tuple[float, float, float]
    zone: int

    @classmethod
    def of(cls, detection: Detection, origin_ns: int) -> Reading:
        """Return a detection for a picture whose time zero is `origin_ns`."""
        x, y, z = detection.place.position_m.tolist()
        return cls(
            id=detection.id,
            name='marker',
            start_s=(detection.start_ns - origin_ns) * 1e-9,
            position_m=(x, y, z),
            zone=detection.zones[0],
        )


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
    for zone, (x, y) in enumerate(grid.tangents):
        axes.text(
            x - 0.44 * grid.pitch,
            y - 0.44 * grid.pitch,
            str(zone),
            fontsize=7,
            color='0.35',
            ha='left',
            va='top',
        )
    degrees = np.array([-20, -10, 0, 10, 20])
    axes.set_xticks(np.tan(np.radians(degrees)), [f'{d}°' for d in degrees])
    axes.set_yticks(np.tan(np.radians(degrees)), [f'{-d}°' for d in degrees])
    axes.set_xlabel('to the right')
    axes.set_ylabel('upwards')
    colorbar = axes.figure.colorbar(image, ax=axes, orientation='horizontal', pad=0.14, aspect=30)
    colorbar.set_label('standard deviation of the signal [kcps/SPAD]', fontsize=9)


def _signal_with_bits(
    axes: Any, recording: Recording, origin_ns: int, reading: Reading, colour: str
) -> None:
    """Draw one zone's signal about a reading, and the bits that were read from it."""
    time_s = (recording.stamp_ns - origin_ns) * 1e-9
    begin = max(reading.start_s - 0.4, 0.0)
    shown = (time_s >= begin) & (time_s <= begin + _SHOWN_S)
    signal = recording.signal[shown, reading.zone]
    axes.step(time_s[shown], signal, where='mid', color=colour, linewidth=1.1)
    low, high = float(signal.min()), float(signal.max())
    room = max(high - low, 1.0)
    axes.set_ylim(low - 0.1 * room, high + 0.35 * room)
    axes.set_xlim(begin, begin + _SHOWN_S)
    bits: NDArray[np.uint8] = packet(reading.id)
    for index, bit in enumerate(bits):
        left = reading.start_s + index * BIT_PERIOD_S
        in_preamble = index < len(PREAMBLE)
        if bit:
            axes.axvspan(left, left + BIT_PERIOD_S, color=colour, alpha=0.14, linewidth=0)
        axes.text(
            left + BIT_PERIOD_S / 2,
            high + 0.2 * room,
            str(bit),
            ha='center',
            va='center',
            fontsize=7,
            color='0.5' if in_preamble else 'black',
            clip_on=True,
        )
    axes.set_ylabel('kcps/SPAD', fontsize=9)
    axes.set_title(
        f'{reading.name}, ID {reading.id}, zone {reading.zone}',
        loc='left',
        fontsize=10,
        color=colour,
    )


def plot_readings(
    recording: Recording,
    readings: Sequence[Reading],
    path: Path,
    *,
    origin_ns: int,
    title: str,
    truth_m: Mapping[str, tuple[float, float, float]] | None = None,
) -> None:
    """Write a PNG of a recording and the first reading of each marker in it.

    Parameters
    ----------
    recording : Recording
        The frames.
    readings : sequence of Reading
        What was read, in order of time; start times count from `origin_ns`.
    path : Path
        Where the picture goes.
    origin_ns : int
        Time zero of the picture [ns].
    title : str
        Heads the picture.
    truth_m : mapping of str to (x, y, z), optional
        Where markers really are [m], by name.
    """
    import matplotlib as mpl

    mpl.use('Agg')
    import matplotlib.pyplot as plt

    first: dict[int, Reading] = {}
    for reading in readings:
        first.setdefault(reading.id, reading)
    chosen = list(first.values())[:_MOST_SIGNALS]
    rows = max(len(chosen), 1)
    figure = plt.figure(figsize=(13, max(5.2, 1.2 + 1.75 * rows)), layout='constrained')
    figure.suptitle(title, fontsize=13)
    spaces = figure.add_gridspec(rows, 2, width_ratios=(1, 1.9))
    zones = figure.add_subplot(spaces[:, 0])
    _zone_of_interest(zones, recording.grid, recording.signal.std(axis=0).astype(np.float64))
    for name, (x, y, z) in (truth_m or {}).items():
        zones.plot(x / z, y / z, marker='s', markersize=9, fillstyle='none', color='black')
        zones.annotate(
            name,
            (x / z, y / z),
            xytext=(0, 9),
            textcoords='offset points',
            ha='center',
            fontsize=9,
            bbox={'facecolor': 'white', 'alpha': 0.8, 'edgecolor': 'none', 'pad': 1},
        )
    for index, reading in enumerate(chosen):
        colour = _COLOURS[index % len(_COLOURS)]
        x, y, z = reading.position_m
        zones.plot(x / z, y / z, marker='x', markersize=9, markeredgewidth=2, color=colour)
        axes = figure.add_subplot(spaces[index, 1])
        _signal_with_bits(axes, recording, origin_ns, reading, colour)
        if index == len(chosen) - 1:
            axes.set_xlabel('time [s]')
    if not chosen:
        zones.set_title('nothing was read', fontsize=10)
    elif truth_m:
        zones.set_title('square: marker, cross: read', fontsize=10)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)
