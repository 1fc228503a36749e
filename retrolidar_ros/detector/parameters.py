# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a detector: declared by the node, and options of the command."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from retrolidar_ros.detector.methods import Detector, create_detector
from retrolidar_ros.marker.known_markers import KnownMarker, load_markers
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, NoiseLaw
from retrolidar_ros.settings.parameter import declared, only_values
from retrolidar_ros.settings.section import suggestion

READING = (
    *('method', 'bit_period', 'false_ids_per_hour', 'max_packets', 'marker_file'),
    *('only_registered', 'registered_ids', 'min_readings'),
    *('noise_floor', 'noise_slope', 'noise_ambient', 'range_offset', 'zone_pitch', 'zone_blur'),
    'likelihood_threshold',
)
"""Those that decide what is read and where."""


def defaults() -> dict[str, Any]:
    """Return all parameters of the detector node as they are shipped."""
    return {name: one.default for name, one in declared()['detector'].items()}


def load_parameters(path: Path) -> dict[str, Any]:
    """Return what a parameter file says of the detector; OSError or ValueError if it is wrong."""
    found = only_values(path, 'detector')
    known = declared()['detector']
    for name, value in found.items():
        if name not in known:
            raise ValueError(f'{path}: {name}: no such parameter; {suggestion(name, known)}')
        found[name] = known[name].check(f'{path}: {name}', value)
    return found


def known_markers(values: Mapping[str, Any]) -> dict[int, KnownMarker]:
    """Return the markers of the marker file; ValueError if it cannot be read."""
    if not values['marker_file']:
        return {}
    try:
        return load_markers(Path(values['marker_file']))
    except (OSError, ValueError) as error:
        raise ValueError(f'marker_file: {error}') from error


class DetectorSettings:
    """Values of all parameters of a detector, and the markers of its file."""

    def __init__(
        self, values: Mapping[str, Any], known: Mapping[int, KnownMarker] | None = None
    ) -> None:
        """Take values, and what the marker file holds if it is known; ValueError if it is wrong."""
        self.values = values
        self.known = known_markers(values) if known is None else known
        self.noise = NoiseLaw(*(values[f'noise_{part}'] for part in ('floor', 'slope', 'ambient')))
        ids = set(values['registered_ids'])
        if values['only_registered']:
            if not self.known:
                raise ValueError('only_registered: there is no marker_file with markers')
            ids |= set(self.known)
        self.registered = sorted(ids)  # the IDs to report; empty = all

    def changed(self, **values: Any) -> DetectorSettings:
        """Return the settings with other values."""
        return DetectorSettings({**self.values, **values}, self.known)

    def detector(self, grid: ZoneGrid) -> Detector:
        """Return a new detector for frames of `grid`; ValueError if a value is invalid."""
        values, pitch = self.values, self.values['zone_pitch']
        return create_detector(
            values['method'],
            grid,
            bit_period_s=values['bit_period'],
            likelihood_threshold=values['likelihood_threshold'],
            false_ids_per_hour=values['false_ids_per_hour'],
            max_packets=values['max_packets'],
            registered_ids=self.registered or None,
            sensor=replace(
                VL53L8CX,
                field_of_view=pitch * grid.columns if pitch else VL53L8CX.field_of_view,
                zone_blur=values['zone_blur'],
                range_offset_m=values['range_offset'],
                noise=self.noise,
            ),
        )
