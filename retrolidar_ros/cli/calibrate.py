# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate parameters from a recording, and describe them on a page."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import numpy as np

from retrolidar_ros.bag import salvage_frames
from retrolidar_ros.cli.arguments import Subparsers, add_bag
from retrolidar_ros.cli.decode import NOTHING_READ
from retrolidar_ros.marker.code import PACKET_BITS, packet
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.settings.section import quantity
from retrolidar_ros.tasks.calibration.calibrate import Calibration, calibrate
from retrolidar_ros.tasks.calibration.report import missing, parameter_file, sentences

_BLUE, _GREY = '#0072b2', '0.6'


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar calibrate`."""
    command = subparsers.add_parser(
        'calibrate',
        help='estimate the parameters of a recorded sensor and its markers',
        description='Writes calibration.yaml, a params_file of the nodes and of decode, and '
        'calibration.md with calibration.png. Only what the recording shows is written. Exit '
        f'code {NOTHING_READ} if no marker is read.',
    )
    add_bag(command)
    command.add_argument('--distance', help="from sensor to clearest marker, as in '1.2 m'")
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
    frames, damage = salvage_frames(arguments.bag, arguments.topic)
    found = calibrate(Recording.of(frames), distance_m=distance_m)
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
    law = found.noise.law.lit(found.noise.light)
    axes.plot(along, law.variance(along), color=_BLUE, label='law that was found')
    axes.set_ylim(0)
    axes.legend(frameon=False)


def _signal(axes: Any, found: Calibration) -> None:
    """Draw the signal of the zone of a marker, and shade the dark bits that were read."""
    axes.set(xlabel='time [s]', ylabel='signal [kcps/SPAD]')
    if not found.markers:
        axes.text(0.5, 0.5, 'no marker was read', ha='center', transform=axes.transAxes)
        return
    marker, recording = found.markers[0], found.recording
    time_s = (recording.stamp_ns - marker.readings[0].start_ns) * 1e-9
    edges_s = marker.bit_period_s.value * np.arange(PACKET_BITS + 1)
    rows = (time_s >= 0) & (time_s < edges_s[-1])
    axes.step(time_s[rows], recording.signal[rows, marker.zone], where='mid', color=_BLUE)
    for index in np.flatnonzero(packet(marker.id)).tolist():
        axes.axvspan(*edges_s[index : index + 2], color=_GREY, alpha=0.4, linewidth=0)
    axes.set(title=f'ID {marker.id} in zone {marker.zone}; grey: dark bits', ylim=(0, None))
