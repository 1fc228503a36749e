# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate parameters and a scene from a recording, and describe them on a page."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from retrolidar_ros.bag import FRAMES_TOPIC, salvage_frames
from retrolidar_ros.cli.arguments import Subparsers
from retrolidar_ros.cli.decode import NOTHING_READ
from retrolidar_ros.marker.code import packet
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.settings.section import quantity
from retrolidar_ros.tasks.calibration.calibrate import Calibration, MarkerFound, calibrate
from retrolidar_ros.tasks.calibration.files import parameter_file, scene
from retrolidar_ros.tasks.calibration.report import missing, sentences

_BLUE, _ORANGE, _GREY = '#0072b2', '#d55e00', '0.6'
_BINS = 60


def add_command(subparsers: Subparsers) -> None:
    """Add `retrolidar calibrate`."""
    command = subparsers.add_parser(
        'calibrate',
        help='estimate the parameters of a recorded sensor and its markers',
        description='Writes calibration.yaml, a params_file of the nodes and of decode; '
        'scene.yaml, for the emulator; and calibration.md with calibration.png. Only what the '
        f'recording shows is written. Exit code {NOTHING_READ} if no marker is read.',
    )
    command.add_argument('bag', type=Path, help='rosbag2 directory, .mcap or .db3 file')
    command.add_argument('--topic', default=FRAMES_TOPIC, help='(default: %(default)s)')
    command.add_argument('--distance', help="from sensor to brightest marker, as in '1.2 m'")
    command.add_argument('--size', default='3 cm', help='edge of markers (default: %(default)s)')
    command.add_argument('--speed', help="of a marker swept straight across, a second: '5 cm'")
    command.add_argument(
        '-o',
        '--output',
        type=Path,
        default=Path('calibration'),
        metavar='DIR',
        help='(default: %(default)s)',
    )
    command.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Calibrate from a bag, as far as it can be read."""

    def length(name: str, least: float, most: float) -> float | None:
        text = getattr(arguments, name)
        return (
            None if text is None else quantity('length', least, most, bare=True)(text, f'--{name}')
        )

    distance_m, speed_m_s = length('distance', 0.05, 10), length('speed', 1e-3, 10)
    size_m = quantity('length', 1e-3, 1, bare=True)(arguments.size, '--size')
    frames, damage = salvage_frames(arguments.bag, arguments.topic)
    found = calibrate(
        Recording.of(frames), distance_m=distance_m, size_m=size_m, speed_m_s=speed_m_s
    )
    source = arguments.bag.name
    lines, wanted = sentences(found), missing(found)
    arguments.output.mkdir(parents=True, exist_ok=True)
    files = {
        'calibration.yaml': parameter_file(found, source),
        'scene.yaml': yaml.safe_dump(scene(found, source), sort_keys=False, allow_unicode=True),
    }
    for name, text in files.items():
        (arguments.output / name).write_text(text, encoding='utf-8')
    _write_page(found, lines, wanted, arguments.output, source)
    print('\n'.join([*lines, *(f'Next: {line}' for line in wanted)]))
    print(f'{arguments.output}: {", ".join(files)}, calibration.md, calibration.png')
    if damage is not None:
        print(f'retrolidar: only what comes before the damage: {damage}', file=sys.stderr)
    return 0 if found.markers else NOTHING_READ


def _write_page(
    found: Calibration, results: Sequence[str], wanted: Sequence[str], directory: Path, source: str
) -> None:
    """Write calibration.md and calibration.png."""
    lines = [f'# Calibration from {source}', '', *(f'* {line}' for line in results), '']
    lines += ['± is half of the interval that holds the truth in 95 of 100 cases.', '']
    if wanted:
        lines += ['## What to record next', '', *(f'* {line}' for line in wanted), '']
    lines += ['![What the estimates rest on](calibration.png)', '']
    (directory / 'calibration.md').write_text('\n'.join(lines), encoding='utf-8')
    _draw(found, directory / 'calibration.png', source)


def _draw(found: Calibration, path: Path, source: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(12, 8), layout='constrained')
    (frames, noise), (signal, fold) = figure.subplots(2, 2)
    figure.suptitle(f'Calibration from {source}', fontsize=13)
    _frames(frames, found)
    _noise(noise, found)
    marker = next((one for one in found.markers if not one.moves), None)
    if marker is None:
        for axes in (signal, fold):
            axes.set_axis_off()
            text = 'no marker at rest was read'
            axes.text(0.5, 0.5, text, ha='center', transform=axes.transAxes)
    else:
        _signal(signal, found, marker)
        _folded(fold, found, marker)
    figure.savefig(path, dpi=110)


def _frames(axes: Any, found: Calibration) -> None:
    """Draw the times between frames."""
    step_ms = np.diff(found.recording.stamp_ns) * 1e-6
    period_ms = 1e3 * found.timing.period_s.value
    axes.hist(np.clip(step_ms, 0, 3.5 * period_ms), bins=_BINS, color=_BLUE)
    axes.set_yscale('log')
    axes.axvline(period_ms, color=_ORANGE, label=f'period, {period_ms:.2f} ms')
    axes.set(xlabel='time between frames [ms]', ylabel='frames', title='Frames')
    axes.legend(frameon=False)


def _noise(axes: Any, found: Calibration) -> None:
    """Draw the variances of steady zones over their signals, and the noise law."""
    axes.set(xlabel='signal [kcps/SPAD]', ylabel='variance [(kcps/SPAD)²]', title='Zones at rest')
    if found.noise is None:
        axes.text(0.5, 0.5, 'no zone is at rest', ha='center', transform=axes.transAxes)
        return
    blocks = found.noise.blocks
    signal = np.array([block.signal for block in blocks])
    variance = [block.variance for block in blocks]
    axes.plot(signal, variance, '.', color=_GREY, label='a zone in some seconds')
    along = np.linspace(0, max(float(signal.max()) * 1.1, 1.0), 50)
    law = found.law.lit(found.noise.light)
    axes.plot(along, law.variance(along), color=_BLUE, label='law that was found')
    axes.set_ylim(0)
    axes.legend(frameon=False)


def _signal(axes: Any, found: Calibration, marker: MarkerFound) -> None:
    """Draw the signal of the marker's zone and the fit, over a packet or two."""
    sent, recording = marker.sent, found.recording
    zone = sent.zones[0]
    time_s = (recording.stamp_ns - recording.stamp_ns[0]) * 1e-9
    begin_s = float(time_s[np.isfinite(sent.light)][0])
    rows = (time_s >= begin_s) & (time_s < begin_s + 45 * sent.bit_period_s.value)
    fitted = sent.level.value + sent.gain.value * sent.light
    axes.plot(time_s[rows], recording.signal[rows, zone], '.', color=_GREY, label='measured')
    axes.plot(time_s[rows], fitted[rows], color=_BLUE, linewidth=1, label='fitted')
    if marker.pedestal:
        axes.axhline(marker.pedestal.value, color=_ORANGE, linestyle=':', label='what is around it')
    axes.set(xlabel='time [s]', ylabel='signal [kcps/SPAD]', title=f'ID {sent.id} in zone {zone}')
    axes.set_ylim(0, 1.2 * float(fitted[rows].max()))
    axes.legend(frameon=False, ncols=3, loc='upper center')


def _folded(axes: Any, found: Calibration, marker: MarkerFound) -> None:
    """Draw all samples about edges of bits against their time from the edge."""
    sent, recording = marker.sent, found.recording
    zone = sent.zones[0]
    bit_s = sent.bit_period_s.value
    time_s = (recording.stamp_ns - recording.stamp_ns[0]) * 1e-9
    bits = packet(sent.id)
    since = (time_s - sent.start_s) / bit_s
    nearest = np.rint(since).astype(int)
    before, after = bits[(nearest - 1) % len(bits)], bits[nearest % len(bits)]
    known = np.isfinite(sent.light)
    for value, name, colour in ((0, 'brightens', _ORANGE), (1, 'darkens', _BLUE)):
        rows = known & (before != after) & (after == value)
        order = np.argsort((since - nearest)[rows])
        late_ms = (1e3 * bit_s * (since - nearest))[rows][order]
        axes.plot(late_ms, recording.signal[rows, zone][order], '.', markersize=3, color=colour)
        fitted = sent.level.value + sent.gain.value * sent.light[rows][order]
        axes.plot(late_ms, fitted, color=colour, linewidth=1, alpha=0.7, label=name)
    axes.set(
        xlabel='middle of the exposure after an edge [ms]',
        ylabel='signal [kcps/SPAD]',
        title='All edges of bits, measured and fitted',
    )
    axes.legend(frameon=False)
