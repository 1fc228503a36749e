# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate parameters from a recording, and describe them on a page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from retrolidar_ros.bag import FRAMES_TOPIC, salvage_frames
from retrolidar_ros.cli.arguments import Subparsers
from retrolidar_ros.cli.decode import NOTHING_READ
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.settings.section import quantity
from retrolidar_ros.tasks.calibration.calibrate import Calibration, calibrate
from retrolidar_ros.tasks.calibration.report import missing, parameter_file, sentences

_BLUE, _GREY = '#0072b2', '0.6'
_SHOWN_BITS = 45


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar calibrate`."""
    command = subparsers.add_parser(
        'calibrate',
        help='estimate the parameters of a recorded sensor and its markers',
        description='Writes calibration.yaml, a params_file of the nodes and of decode, and '
        'calibration.md with calibration.png. Only what the recording shows is written. Exit '
        f'code {NOTHING_READ} if no marker is read.',
    )
    command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    command.add_argument('--topic', default=FRAMES_TOPIC, help='(default: %(default)s)')
    command.add_argument('--distance', help="from sensor to brightest marker, as in '1.2 m'")
    command.add_argument('--size', default='3 cm', help='edge of markers (default: %(default)s)')
    command.add_argument(
        *('-o', '--output'),
        type=Path,
        default=Path('calibration'),
        metavar='DIR',
        help='(default: %(default)s)',
    )
    command.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate from a bag, as far as it can be read."""
    distance_m = None
    if arguments.distance is not None:
        distance_m = quantity('length', 0.05, 10, bare=True)(arguments.distance, '--distance')
    size_m = quantity('length', 1e-3, 1, bare=True)(arguments.size, '--size')
    frames, damage = salvage_frames(arguments.bag, arguments.topic)
    found = calibrate(Recording.of(frames), distance_m=distance_m, size_m=size_m)
    source, output = arguments.bag.name, arguments.output
    output.mkdir(parents=True, exist_ok=True)
    (output / 'calibration.yaml').write_text(parameter_file(found, source), encoding='utf-8')
    (output / 'calibration.md').write_text(_page(found, source), encoding='utf-8')
    _draw(found, output / 'calibration.png', source)
    print('\n'.join([*sentences(found), *(f'Next: {line}' for line in missing(found))]))
    print(f'{output}: calibration.yaml, calibration.md, calibration.png')
    if damage is not None:
        print(f'retrolidar: only what comes before the damage: {damage}', file=sys.stderr)
    return 0 if found.markers else NOTHING_READ


def _page(found: Calibration, source: str) -> str:
    lines = [f'# Calibration from {source}', '', *(f'* {line}' for line in sentences(found)), '']
    lines += ['± is half of the interval that holds the truth in 95 of 100 cases.', '']
    if wanted := missing(found):
        lines += ['## What to record next', '', *(f'* {line}' for line in wanted), '']
    return '\n'.join([*lines, '![What the estimates rest on](calibration.png)', ''])


def _draw(found: Calibration, path: Path, source: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 4.5), layout='constrained')
    noise, signal = figure.subplots(1, 2)
    figure.suptitle(f'Calibration from {source}', fontsize=13)
    _noise(noise, found)
    _signal(signal, found)
    figure.savefig(path, dpi=110)


def _noise(axes: Any, found: Calibration) -> None:
    """Draw the variances of steady zones over their signals, and the noise law."""
    axes.set(xlabel='signal [kcps/SPAD]', ylabel='variance [(kcps/SPAD)²]', title='Zones at rest')
    if found.noise is None:
        axes.text(0.5, 0.5, 'no zone is at rest', ha='center', transform=axes.transAxes)
        return
    signal, variance = np.array([(one.signal, one.variance) for one in found.noise.blocks]).T
    axes.plot(signal, variance, '.', color=_GREY, label='a zone in some seconds')
    along = np.linspace(0, max(float(signal.max()) * 1.1, 1.0), 50)
    law = found.law.lit(found.noise.light)
    axes.plot(along, law.variance(along), color=_BLUE, label='law that was found')
    axes.set_ylim(0)
    axes.legend(frameon=False)


def _signal(axes: Any, found: Calibration) -> None:
    """Draw the signal of the zone of a marker at rest and the fit, over a packet or two."""
    marker = next((one for one in found.markers if not one.moves), None)
    axes.set(xlabel='time [s]', ylabel='signal [kcps/SPAD]')
    if marker is None:
        axes.text(0.5, 0.5, 'no marker at rest', ha='center', transform=axes.transAxes)
        return
    recording = found.recording
    time_s = (recording.stamp_ns - recording.stamp_ns[0]) * 1e-9
    begin_s = float(time_s[np.isfinite(marker.light)][0])
    end_s = begin_s + _SHOWN_BITS * marker.bit_period_s.value
    rows = (time_s >= begin_s) & (time_s < end_s)
    fitted = marker.level + marker.gain.value * marker.light[rows]
    measured = recording.signal[rows, marker.zone]
    axes.plot(time_s[rows], measured, '.', color=_GREY, label='measured')
    axes.plot(time_s[rows], fitted, color=_BLUE, linewidth=1, label='fitted')
    axes.set(title=f'ID {marker.id} in zone {marker.zone}', ylim=(0, 1.2 * float(fitted.max())))
    axes.legend(frameon=False, ncols=2, loc='upper center')
