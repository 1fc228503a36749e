# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was found, in plain sentences; and what to record next for what was not."""

from __future__ import annotations

from retrolidar_ros.sensor.model import Status
from retrolidar_ros.tasks.calibration.calibrate import Calibration, MarkerFound
from retrolidar_ros.tasks.calibration.noise import NoiseFound

_WHITE = 3.0  # standard deviations from it
_LONG_S = 20.0
_NAMES = {int(one): one.name.lower().replace('_', ' ') for one in Status}
_CLOCK = 0.03  # how far a detector looks for a bit period


def sentences(found: Calibration) -> list[str]:
    """Return what was found; ± is half of the interval that holds the truth in 95 of 100 cases."""
    lines = [*_timing(found), *(_noise(found.noise) if found.noise else [])]
    for marker in found.markers:
        lines += _marker(marker)
    read = {zone for marker in found.markers for zone in marker.sent.zones}
    read |= {zone for marker in found.markers for one in marker.readings for zone in one.zones}
    for zone in found.zones:
        if zone.zone not in read and zone.is_clocked:
            lines.append(f'Zone {zone.zone} blinks by {zone.modulation_db:.0f} dB; no ID fits.')
    if link := found.link:
        offset, light = link.offset_m.times(1e3).text('mm'), link.signal_at_1_m.text('kcps/SPAD')
        lines += [
            f'ID {link.marker} is at {link.distance_m:g} m, so ranges are too long by {offset}.',
            f'If it faces the sensor, a bright marker of 3 cm gives {light} at 1 m.',
            f'So 80 % of lone packets of 3 cm are to be expected to {link.reach_m:.1f} m.',
        ]
    if sweep := found.sweep:
        lines.append(
            f'The optics blur by {sweep.blur.times(100).text("% of a zone")}, by {sweep.passes} '
            'passes of a marker.'
        )
        if sweep.pitch:
            lines.append(f'A zone is {sweep.pitch.text()} wide, as a tangent.')
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
    white = 'it is white' if abs(value) < _WHITE * stddev else 'it is not white'
    lines.append(
        f'Successive samples correlate by {noise.correlation.text()}: as far as seen {white}.'
    )
    return lines


def _marker(marker: MarkerFound) -> list[str]:
    sent = marker.sent
    zone = sent.zones[0]
    name = f'ID {sent.id}'
    lines = [
        (
            f'{name} was read {len(marker.readings)} times, best in zone {zone}; its bits last '
            f'{sent.bit_period_s.times(1e3).text("ms")}.'
        )
    ]
    if marker.moves:
        return [*lines, f'{name} moves, so its light and its crystal are not known.']
    lines.append(
        f'{name}: zone {zone} has {sent.level.text("kcps/SPAD")} when it is dark, and '
        f'{sent.gain.text("kcps/SPAD")} more when it is bright.'
    )
    if marker.range_m:
        lines.append(f'{name} is measured at {marker.range_m.text("m")}.')
    if marker.flipped:
        return [*lines, f'{name}: dark bits show something behind it, so its crystal is not known.']
    lines.append(
        f'{name}: from 10 to 90 % the crystal brightens in {sent.bright_s.times(1e3).text("ms")} '
        f'and darkens in {sent.dark_s.times(1e3).text("ms")}.'
    )
    if marker.contrast and marker.pedestal:
        lines.append(
            f'{name}: the crystal blocks {marker.contrast.times(100).text("%")} of its light; '
            f'{marker.pedestal.text("kcps/SPAD")} are of what is around it.'
        )
    else:
        lines.append(
            f'{name}: the crystal blocks {100 * marker.least_contrast:.0f} % of its light at least.'
        )
    return lines


def missing(found: Calibration) -> list[str]:
    """Return what to record or change next, for what the recording does not show."""
    noise, markers = found.noise, found.markers
    still = [marker for marker in markers if not marker.moves]
    flipped = any(marker.flipped for marker in still)
    periods = [marker.sent.bit_period_s.value for marker in markers] or [1.0]
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
        'For the offset of ranges and the reach: measure the way from the sensor to the '
        'brightest marker, and give --distance.': still and found.link is None,
        'For the crystal: put the marker less than half a metre before a wall.': flipped,
        'For the contrast: let three zones see the wall that the marker hangs on, and only it.': (
            not flipped and any(marker.contrast is None for marker in still)
        ),
        'For the blur: move a marker evenly across the view, through a zone in four packets '
        'or slower; with --speed for the width of zones.': found.sweep is None,
        'The markers have different bit periods; a detector reads one. That of the brightest '
        'is written.': max(periods) > (1 + _CLOCK) * min(periods),
    }
    return [line for line, wants in wanted.items() if wants]
