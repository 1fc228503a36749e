# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The report: parameters, plain sentences, and what to record next."""

from __future__ import annotations

from retrolidar_ros.sensor.model import Status
from retrolidar_ros.tasks.calibration.calibrate import Calibration
from retrolidar_ros.tasks.calibration.markers import MarkerFound
from retrolidar_ros.tasks.calibration.noise import NoiseFound

_WHITE = 3.0  # standard deviations from it
_LONG_S = 20.0
_NAMES = {int(one): one.name.lower().replace('_', ' ') for one in Status}
_CLOCK = 0.03  # how far a detector looks for a bit period


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
    if found.link:
        values['range_offset'] = (found.link.offset_m.value, f'{found.link.offset_m.text()} m')
    return values


def parameter_file(found: Calibration, source: str) -> str:
    """Return the text of a parameter file; nodes use defaults for the rest."""
    lines = [
        f'# From {source}, by `retrolidar calibrate`. What is not here was not found in it.',
        '/**/detector:',
    ]
    values = parameters(found)
    lines.append('  ros__parameters:' if values else '  ros__parameters: {}')
    # ROS takes a number without a point for another type, and YAML one with an exponent for text.
    lines += [f'    {name}: {value:.6f}  # {remark}' for name, (value, remark) in values.items()]
    return '\n'.join(lines) + '\n'


def sentences(found: Calibration) -> list[str]:
    """Return what was found; ± is half of the interval that holds the truth in 95 of 100 cases."""
    lines = [*_timing(found), *(_noise(found.noise) if found.noise else [])]
    for marker in found.markers:
        lines += _marker(marker)
    read = {zone for marker in found.markers for one in marker.readings for zone in one.zones}
    lines += [
        f'Zone {zone.zone} blinks by {zone.modulation_db:.0f} dB; no ID fits.'
        for zone in found.zones
        if zone.zone not in read and zone.is_clocked
    ]
    if link := found.link:
        offset, light = link.offset_m.times(1e3).text('mm'), link.signal_at_1_m.text('kcps/SPAD')
        lines += [
            f'ID {link.marker} is at {link.distance_m:g} m, so ranges are too long by {offset}.',
            f'If it faces the sensor, a marker of 3 cm blinks by {light} at 1 m.',
            f'Expected range of a 3 cm marker: {link.reach_m:.1f} m.',
        ]
    return lines


def _timing(found: Calibration) -> list[str]:
    one, grid = found.timing, found.recording.grid
    statuses = ', '.join(
        f'{code} ({_NAMES.get(code, "other")}) {100 * share:.1f} %'
        for code, share in one.statuses.items()
    )
    period, jitter = (time.times(1e3).text('ms') for time in (one.period_s, one.jitter_s))
    lost, gap_ms = one.lost.times(100).text('%'), 1e3 * one.longest_gap_s
    return [
        f'{one.frames} frames of {grid.rows}x{grid.columns} zones in {one.duration_s:.1f} s.',
        f'A frame comes every {period}, with a jitter of {jitter}.',
        f'{lost} of the frames are lost; the longest gap is {gap_ms:.0f} ms.',
        f'Statuses: {statuses}.',
    ]


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
    value, stddev = noise.correlation
    white = 'uncorrelated' if abs(value) < _WHITE * stddev else f'correlated by {value:.2f}'
    lines.append(f'Noise is {white} from frame to frame.')
    return lines


def _marker(marker: MarkerFound) -> list[str]:
    name, clock = f'ID {marker.id}', marker.bit_period_s.times(1e3).text('ms')
    dark, more = f'{marker.level:.1f} kcps/SPAD', marker.gain.text('kcps/SPAD')
    lines = [f'{name} was read {len(marker.readings)} times, best in zone {marker.zone}.']
    lines += [f'{name}: bits last {clock}.']
    if marker.moves:
        return [*lines, f'{name} moves, so its signal and its range are not known.']
    lines += [f'{name}: zone {marker.zone} has {dark} when it is dark, {more} more when bright.']
    return [*lines, f'{name} is measured at {marker.range_m.text("m")}.']


def missing(found: Calibration) -> list[str]:
    """Return what to record or change next, for what the recording does not show."""
    noise, markers = found.noise, found.markers
    still = [marker for marker in markers if not marker.moves]
    periods = [marker.bit_period_s.value for marker in markers] or [1.0]
    wanted = {
        'Record half a minute: every estimate gets more certain with time.': (
            found.timing.duration_s < _LONG_S
        ),
        'No zone is at rest, so the noise is not known: record with the sensor and all but the '
        'markers standing still.': noise is None,
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
        'For the offset and the expected range: measure the distance from the sensor to the '
        'brightest marker, and give --distance.': still and found.link is None,
        'The markers have different bit periods; a detector reads one. That of the brightest '
        'is written.': max(periods) > (1 + _CLOCK) * min(periods),
    }
    return [line for line, wants in wanted.items() if wants]
