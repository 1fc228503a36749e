# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate parameters from a recording."""

import argparse
from pathlib import Path

import numpy as np

from retrolidar_ros.bag import salvage_frames
from retrolidar_ros.cli.arguments import add_bag, measured, output_path
from retrolidar_ros.cli.decode import NOTHING_READ
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.tasks.calibration.calibrate import Calibration, calibrate
from retrolidar_ros.tasks.calibration.report import missing, parameter_file, sentences

HELP = 'estimate the parameters of a recorded sensor and its markers'
DESCRIPTION = (
    'Writes calibration.yaml, a parameter file of the nodes and of decode, with what the recording '
    'shows, and calibration.png, the noise over the signal. '
    f'Exit code {NOTHING_READ} if no marker is read.'
)


def add_arguments(command: argparse.ArgumentParser) -> None:
    """Add the arguments."""
    add_bag(command)
    command.add_argument(
        '--distance',
        type=measured('length', 0.05, 10),
        help="measured distance from the sensor to the clearest marker, as in '1.2 m'",
    )
    command.add_argument(
        *('-o', '--output'),
        type=output_path,
        default=Path('calibration'),
        metavar='DIR',
        help='directory to write to (default: %(default)s)',
    )


def run(arguments: argparse.Namespace) -> int:
    """Calibrate from a bag, as far as it can be read."""
    source, output = arguments.bag.name, arguments.output
    if output.is_file():
        raise ValueError(f'{output} is a file; name a directory with -o')
    frames, damage = salvage_frames(arguments.bag, arguments.topic)
    found = calibrate(Recording.of(frames), distance_m=arguments.distance)
    output.mkdir(exist_ok=True)
    (output / 'calibration.yaml').write_text(parameter_file(found, source), encoding='utf-8')
    _draw(found, output / 'calibration.png', source)
    print('\n'.join([*sentences(found), *(f'Next: {line}' for line in missing(found))]))
    print(f'{output}: calibration.yaml, calibration.png')
    if damage is not None:
        raise damage
    return 0 if found.markers else NOTHING_READ


def _draw(found: Calibration, path: Path, source: str) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.5, 4.5), layout='constrained')
    axes = figure.subplots()
    axes.set(xlabel='signal [kcps/SPAD]', ylabel='variance [(kcps/SPAD)²]')
    axes.set_title(f'Noise of zones at rest, from {source}')
    if (noise := found.noise) is None:
        axes.text(0.5, 0.5, 'no zone is at rest', ha='center', transform=axes.transAxes)
    else:
        signal, variance = np.array([(one.signal, one.variance) for one in noise.blocks]).T
        axes.plot(signal, variance, '.', color='0.6', label='a zone in some seconds')
        along = np.linspace(0, max(float(signal.max()) * 1.1, 1.0), 50)
        axes.plot(along, noise.law.lit(noise.light).variance(along), label='law that was found')
        axes.set_ylim(0)
        axes.legend(frameon=False)
    figure.savefig(path, dpi=110)
