# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate parameters from a recording, and report them in plain sentences."""

import argparse
from pathlib import Path

import numpy as np

from retrolidar_ros.bag import salvage_frames
from retrolidar_ros.cli.arguments import add_bag, measured, output_path
from retrolidar_ros.cli.decode import NOTHING_READ
from retrolidar_ros.detector.findings import Cause, Finding
from retrolidar_ros.sensor.frame import Recording
from retrolidar_ros.tasks.calibration import Calibration, MarkerFound, calibrate
from retrolidar_ros.tasks.noise import NoiseFound

HELP = 'estimate the parameters of a recorded sensor and its markers'
DESCRIPTION = (
    'Writes calibration.yaml, a parameter file of the nodes and of decode, with what the recording '
    'shows, and calibration.png, the noise over the signal. '
    f'Exit code {NOTHING_READ} if no marker is read.'
)
_LONG_S = 20.0


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


def parameters(found: Calibration) -> dict[str, tuple[float, str]]:
    """Return the parameters of the detector that were found, each with a remark."""
    values: dict[str, tuple[float, str]] = {}
    if found.markers:
        period = found.markers[0].bit_period_s
        values['bit_period'] = (period.value, f'{period.text()} s')
    if noise := found.noise:
        slope = noise.slope.text() if noise.slope else 'not known: the usual shape, scaled'
        ambient = noise.ambient.text() if noise.ambient else 'its part is in the floor'
        values['noise_floor'] = (noise.law.floor, noise.floor.text())
        values['noise_slope'] = (noise.law.slope, slope)
        values['noise_ambient'] = (noise.law.ambient, ambient)
    if offset_m := found.offset_m:
        values['range_offset'] = (offset_m.value, f'{offset_m.text()} m')
    return values


def parameter_file(found: Calibration, source: str) -> str:
    """Return the text of a parameter file; nodes use defaults for the rest."""
    lines = [
        f'# From {source}, by `retrolidar calibrate`. What is not here was not found in it.',
        '# ± is half of the interval that holds the truth in 95 of 100 cases.',
        *(f'# {line}' for line in sentences(found)),
        *(f'# Next: {line}' for line in missing(found)),
        '/**/detector:',
    ]
    values = parameters(found)
    lines.append('  ros__parameters:' if values else '  ros__parameters: {}')
    # ROS takes a number without a point for another type, and YAML one with an exponent for text.
    lines += [f'    {name}: {value:.6f}  # {remark}' for name, (value, remark) in values.items()]
    return '\n'.join(lines) + '\n'


def sentences(found: Calibration) -> list[str]:
    """Return what was found; ± is half of the interval that holds the truth in 95 of 100 cases."""
    lines = _noise(found.noise) if found.noise else []
    for marker in found.markers:
        lines += _marker(marker)
    read = {zone for marker in found.markers for one in marker.readings for zone in one.zones}
    lines += [
        f'Zone {zone.zone} blinks by {zone.modulation_db:.0f} dB; no ID fits.'
        for zone in found.zones
        if zone.zone not in read and zone.is_clocked
    ]
    if found.offset_m and (still := found.still):
        far_m, offset = still.range_m.value - found.offset_m.value, found.offset_m.times(1e3)
        lines.append(
            f'ID {still.id} is at {far_m:g} m, so ranges are too long by {offset.text("mm")}.'
        )
    return lines


def _noise(noise: NoiseFound) -> list[str]:
    lines = [f'{len(noise.zones)} zones are at rest.']
    law = f'The variance of the noise is {noise.floor.text("(kcps/SPAD)²")}'
    if noise.slope is None:
        signal = sum(block.signal for block in noise.blocks) / len(noise.blocks)
        lines.append(
            f'{law} at a signal of about {signal:.0f} kcps/SPAD; how it grows with the signal is '
            'not known, and is taken to be as usual.'
        )
    else:
        lines.append(f'{law} and {noise.slope.text("kcps/SPAD")} times the signal.')
    lines.append(
        f'Ambient light adds {noise.ambient.text("kcps/SPAD")} times itself.'
        if noise.ambient
        else f'That holds in ambient light of {noise.light:.0f} kcps/SPAD, which did not vary.'
    )
    return lines


def _marker(marker: MarkerFound) -> list[str]:
    name, clock = f'ID {marker.id}', marker.bit_period_s.times(1e3).text('ms')
    return [
        f'{name} was read {len(marker.readings)} times, best in zone {marker.zone}.',
        f'{name}: bits last {clock}.',
        f'{name} moves, so its range is not known.'
        if marker.moves
        else f'{name} is measured at {marker.range_m.text("m")}.',
    ]


def missing(found: Calibration) -> list[str]:
    """Return what to record or change next, for what the recording does not show."""
    noise, markers = found.noise, found.markers
    wanted = {
        'Record half a minute: every estimate gets more certain with time.': (
            found.duration_s < _LONG_S
        ),
        'No zone is at rest, so the noise is not known: record with the sensor and all but the '
        'markers standing still.': noise is None and not found.is_noiseless,
        f'{Finding(Cause.NO_NOISE)}.'.capitalize(): found.is_noiseless,
        'All zones at rest are alike: put white paper at several distances into the view, and '
        'the noise is measured at all of their signals.': noise and noise.slope is None,
        'Switch a lamp on and off while recording for the noise of ambient light.': (
            noise and noise.ambient is None
        ),
        'No zone blinks: wake a marker 0.5 to 1 m away, so that it repeats its packet.': (
            not found.zones
        ),
        'Zones blink, but no ID can be read: put one marker nearer, alone in its zone, and let '
        'it repeat its packet; each bit is to last one to eight frames.': found.zones
        and not markers,
        'For the offset: measure the distance from the sensor to the clearest marker, and give '
        '--distance.': found.still and found.offset_m is None,
    }
    return [line for line, wants in wanted.items() if wants]


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
