# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What was found as a parameter file for the nodes, and as a scene for the emulator."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from retrolidar_ros.tasks.calibration.calibrate import Calibration, MarkerFound

_LEAST_RANGING = 1e-4


def parameters(found: Calibration) -> dict[str, tuple[float, str]]:
    """Return the parameters of the detector that were found, each with a remark."""
    values: dict[str, tuple[float, str]] = {}
    if found.markers:
        period = found.markers[0].sent.bit_period_s
        values['bit_period'] = (period.value, f'{period.text()} s')
    if noise := found.noise:
        law = noise.law
        slope = noise.slope.text() if noise.slope else 'not known: the usual shape, scaled'
        ambient = noise.ambient.text() if noise.ambient else 'its part is in the floor'
        values['noise_floor'] = (law.floor, noise.floor.text())
        values['noise_slope'] = (law.slope, slope)
        values['noise_ambient'] = (law.ambient, ambient)
    if found.link:
        values['range_offset'] = (found.link.offset_m.value, f'{found.link.offset_m.text()} m')
    if found.sweep:
        values['zone_blur'] = (found.sweep.blur.value, found.sweep.blur.text())
        if found.sweep.pitch:
            values['zone_pitch'] = (found.sweep.pitch.value, found.sweep.pitch.text())
    return values


def parameter_file(found: Calibration, source: str) -> str:
    """Return the text of a parameter file; a node takes what it lacks from the usual one."""
    lines = [
        f'# From {source}, by `retrolidar calibrate`. What is not here was not found in it.',
        '/**/detector:',
    ]
    values = parameters(found)
    lines.append('  ros__parameters:' if values else '  ros__parameters: {}')
    # ROS takes a number without a point for another type, and YAML one with an exponent for text.
    lines += [f'    {name}: {value:.6f}  # {remark}' for name, (value, remark) in values.items()]
    return '\n'.join(lines) + '\n'


def scene(found: Calibration, source: str) -> dict[str, Any]:
    """Return a scene that resembles the recording, as a scene file has it."""
    recording, timing, noise = found.recording, found.timing, found.noise
    grid = recording.grid
    sensor: dict[str, Any] = {
        'zones': f'{grid.rows}x{grid.columns}',
        'period': f'{1e3 * timing.period_s.value:.4f} ms',
        'jitter': f'{1e3 * min(timing.jitter_s.value, 5e-3, 0.24 * timing.period_s.value):.3f} ms',
        'lost': f'{100 * min(timing.lost.value, 0.99):.2f} %',
    }
    if noise:
        law = noise.law
        sensor['noise'] = {
            'floor': f'{law.floor:.4g} (kcps/SPAD)^2',
            'slope': f'{law.slope:.4g} kcps/SPAD',
            'ambient': f'{law.ambient:.4g} kcps/SPAD',
        }
        if noise.ranging:
            shot, floor = noise.ranging
            sensor['ranging'] = {
                'shot': f'{1e3 * shot:.0f} mm',
                'floor': f'{1e3 * max(floor, _LEAST_RANGING):.2f} mm',
                'offset': f'{1e3 * _offset(found):.1f} mm',
            }
    if found.sweep:
        sensor['blur'] = f'{100 * found.sweep.blur.value:.1f} %'
    content: dict[str, Any] = {
        'description': f'As recorded in {source}',
        'duration': f'{max(timing.duration_s, 1.0):.0f} s',
        'ambient': f'{max(float(np.nanmean(recording.ambient)), 0.0):.3g} kcps/SPAD',
        'sensor': sensor,
        'markers': [_marker(marker, found) for marker in found.markers],
        'surfaces': _surfaces(found),
    }
    return {key: value for key, value in content.items() if value}


def _offset(found: Calibration) -> float:
    """Return by how much ranges are too long [m], as far as is known."""
    return found.link.offset_m.value if found.link else 0.0


def _marker(marker: MarkerFound, found: Calibration) -> dict[str, Any]:
    """Return a marker where it was read for the most part."""
    sent = marker.sent
    place = np.median([one.place.position_m for one in marker.readings], axis=0)
    range_m = float(np.linalg.norm(place))
    x, y, z = (place * (1 - _offset(found) / range_m)).tolist()
    bit_s = sent.bit_period_s.value
    content: dict[str, Any] = {
        'id': sent.id,
        'position': [f'{x:.4f} m', f'{y:.4f} m', f'{max(z, 0.01):.4f} m'],
        'size': f'{1e3 * found.size_m:.1f} mm',
        'bit_period': f'{1e3 * bit_s:.5f} ms',
    }
    if marker.moves or marker.flipped:
        return content
    dark_s, bright_s = (
        min(max(time.value, 5e-5), bit_s / 2.001) for time in (sent.dark_s, sent.bright_s)
    )
    content['response'] = {'dark': f'{1e3 * dark_s:.3f} ms', 'bright': f'{1e3 * bright_s:.3f} ms'}
    if marker.contrast:
        content['contrast'] = f'{100 * min(marker.contrast.value, 1.0):.1f} %'
    if found.link:
        content['signal_at_1_m'] = f'{found.link.signal_at_1_m.value:.1f} kcps/SPAD'
    return content


def _surfaces(found: Calibration) -> list[dict[str, Any]]:
    """Return what each zone at rest sees, and what is around markers."""
    if found.noise is None:
        return []
    surfaces = []
    factors = found.recording.grid.z_per_range
    signals = {zone: found.noise.signal(zone) for zone in found.noise.zones}
    for one in found.markers:
        if one.pedestal and not one.moves:
            signals[one.sent.zones[0]] = one.pedestal.value
    for zone, signal in signals.items():
        distance = float(np.nanmedian(found.recording.distance[:, zone]))
        distance -= _offset(found) * float(factors[zone])
        if math.isfinite(distance) and distance > 0:
            surfaces.append(
                {
                    'distance': f'{distance:.3f} m',
                    'signal': f'{max(signal, 0.0):.2f} kcps/SPAD',
                    'zones': [zone],
                }
            )
    return surfaces
