# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the detector node, and the detector that they ask for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from retrolidar_ros.detector import METHODS, Detector, create_detector
from retrolidar_ros.detector.methods import MAX_PACKETS
from retrolidar_ros.detector.noise import NoiseLaw
from retrolidar_ros.marker.code import BIT_PERIOD_LIMITS_S, IDS
from retrolidar_ros.marker.known_markers import KnownMarker, load_markers
from retrolidar_ros.nodes.parameters import Parameters, check_frame_id
from retrolidar_ros.sensor.frame import ZoneGrid

NAME = '{name}'
"""What stands for a marker's name in `child_frame`."""
OF_DETECTOR = (
    'method',
    'bit_period',
    'false_ids_per_hour',
    'max_packets',
    'registered_ids',
    'only_registered',
    'noise_floor',
    'noise_slope',
    'noise_ambient',
    'likelihood_threshold',
)
"""What a change of these costs: the frames that the detector has seen so far."""


def known_markers(values: dict[str, Any]) -> dict[int, KnownMarker]:
    """Return the markers of the marker file; ValueError if it cannot be, or `child_frame`."""
    if values['child_frame'].count(NAME) != 1:
        raise ValueError(f'child_frame: {values["child_frame"]!r} needs {NAME} once')
    check_frame_id('child_frame', values['child_frame'])
    if not values['marker_file']:
        return {}
    try:
        return load_markers(Path(values['marker_file']))
    except OSError as error:
        raise ValueError(f'marker_file: {error}') from error


def registered_ids(values: dict[str, Any], known: dict[int, KnownMarker]) -> list[int]:
    """Return the only IDs that may come; empty = all. ValueError if there can be none."""
    registered = set(values['registered_ids'])
    if values['only_registered']:
        if not known:
            raise ValueError('only_registered: there is no marker_file with markers')
        registered |= set(known)
    return sorted(registered)


def noise_of(values: dict[str, Any]) -> NoiseLaw:
    """Return the noise of the sensor."""
    return NoiseLaw(values['noise_floor'], values['noise_slope'], values['noise_ambient'])


def detector_of(values: dict[str, Any], known: dict[int, KnownMarker], grid: ZoneGrid) -> Detector:
    """Return a new detector; ValueError if there cannot be such a one."""
    return create_detector(
        values['method'],
        grid,
        bit_period_s=values['bit_period'],
        likelihood_threshold=values['likelihood_threshold'],
        false_ids_per_hour=values['false_ids_per_hour'],
        max_packets=values['max_packets'],
        registered_ids=registered_ids(values, known) or None,
        noise=noise_of(values),
        marker_sizes_m={marker.id: marker.size_m for marker in known.values()},
    )


def declare(parameters: Parameters) -> None:
    """Declare all of them."""
    parameters.text('method', 'How markers are read.', METHODS, live=True)
    parameters.number(
        'bit_period',
        'How long a marker holds a bit: two frames [s].',
        *BIT_PERIOD_LIMITS_S,
        live=True,
    )
    parameters.number(
        'false_ids_per_hour',
        'How many false IDs may come in an hour, over all zones (joint).',
        1e-6,
        1e6,
        live=True,
    )
    parameters.integer(
        'max_packets',
        'How many packets of a repeating marker may be combined (joint).',
        1,
        MAX_PACKETS,
        live=True,
    )
    parameters.text('marker_file', 'YAML file of the known markers; empty = none.')
    parameters.flag(
        'only_registered',
        'Let only markers of the marker file come, and registered_ids.',
        live=True,
    )
    parameters.integers(
        'registered_ids', 'The only IDs that may come; [] = all.', 0, IDS - 1, live=True
    )
    parameters.number(
        'noise_floor',
        'Variance of a signal of nothing [(kcps/SPAD)^2] (joint).',
        1e-6,
        1e6,
        live=True,
    )
    parameters.number(
        'noise_slope',
        'By how much the variance grows with the signal [kcps/SPAD] (joint).',
        0.0,
        1e6,
        live=True,
    )
    parameters.number(
        'noise_ambient',
        'By how much the variance grows with the ambient light [kcps/SPAD] (joint).',
        0.0,
        1e6,
        live=True,
    )
    parameters.number(
        'likelihood_threshold', 'Least likelihood of a preamble (paper).', 1e-6, 1e6, live=True
    )
    parameters.flag('publish_tf', 'Send a transform for every detection.', live=True)
    parameters.text('child_frame', 'TF frame of a marker; {name} stands for its name.')
    parameters.number(
        'stale_after',
        'How long marker_array shows a marker after a reading [s].',
        0.1,
        3600.0,
        live=True,
    )
