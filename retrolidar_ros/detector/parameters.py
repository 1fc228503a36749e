# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of a detector: what the node declares, and what the command takes as options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NamedTuple

from retrolidar_ros.detector.detection import Detector
from retrolidar_ros.detector.methods import MAX_PACKETS, METHODS, create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_LIMITS_S, IDS
from retrolidar_ros.marker.known_markers import KnownMarker, load_markers
from retrolidar_ros.sensor.frame import ZoneGrid
from retrolidar_ros.sensor.model import VL53L8CX, SensorModel
from retrolidar_ros.sensor.noise import NoiseLaw
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_parameter_defaults, load_yaml


class Parameter(NamedTuple):
    """One parameter, whose default stands in `config/retrolidar.yaml`."""

    kind: type
    """int or float within limits, str, bool, or list of int within limits."""
    description: str
    limits: tuple[float, float] = (0.0, 0.0)
    among: tuple[str, ...] = ()
    live: bool = True
    """Whether it may be set while the node runs."""


_LAW = (0.0, 1e6)
PARAMETERS = {
    'method': Parameter(str, 'How markers are read.', among=METHODS),
    'bit_period': Parameter(float, 'Duration of a bit [s].', BIT_PERIOD_LIMITS_S),
    'false_ids_per_hour': Parameter(
        float, 'Allowed false IDs per hour, over all zones (joint).', (1e-6, 1e6)
    ),
    'max_packets': Parameter(
        int, 'Packets of a repeating marker that may be combined (joint).', (1, MAX_PACKETS)
    ),
    'marker_file': Parameter(str, 'YAML file of the known markers; empty = none.', live=False),
    'only_registered': Parameter(
        bool, 'Report only markers of the marker file, and registered_ids.'
    ),
    'registered_ids': Parameter(list, 'IDs to report; [] = all.', (0, IDS - 1)),
    'min_readings': Parameter(
        int, 'Readings of a marker that must agree before it is reported.', (1, 100)
    ),
    'noise_floor': Parameter(
        float, 'Variance of the noise at zero signal [(kcps/SPAD)^2] (joint).', (1e-6, 1e6)
    ),
    'noise_slope': Parameter(
        float, 'Growth of the variance with the signal [kcps/SPAD] (joint).', _LAW
    ),
    'noise_ambient': Parameter(
        float, 'Growth of the variance with the ambient light [kcps/SPAD] (joint).', _LAW
    ),
    'range_offset': Parameter(float, 'Excess of all measured ranges [m] (joint).', (-0.5, 0.5)),
    'zone_pitch': Parameter(
        float, "Width of a zone as a tangent; 0 = the sensor's usual one (joint).", (0.0, 1.0)
    ),
    'zone_blur': Parameter(
        float, 'Blur of the optics in zone widths; 0 = unknown (joint).', (0.0, 1.0)
    ),
    'likelihood_threshold': Parameter(
        float, 'Minimum likelihood of a preamble (paper).', (1e-6, 1e6)
    ),
}
"""Those that decide what is read and where; the node has a few more."""


def defaults() -> dict[str, Any]:
    """Return all parameters of the detector node as they are shipped."""
    return load_parameter_defaults(shared_file('config/retrolidar.yaml'), 'detector')


def load_parameters(path: Path) -> dict[str, Any]:
    """Return what a parameter file of ROS says of detectors.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is no such file, or has a parameter that no detector has, or of another type.
    """
    content = load_yaml(path)
    known = defaults()
    found: dict[str, Any] = {}
    if not isinstance(content, Mapping):
        raise ValueError(f'{path}: is no parameter file: it has no nodes')
    for node, section in content.items():
        if str(node).rsplit('/', 1)[-1] not in ('detector', '**'):
            continue
        if not isinstance(section, Mapping) or 'ros__parameters' not in section:
            raise ValueError(f'{path}: {node} has no ros__parameters')
        found.update(section['ros__parameters'] or {})
    for name, value in found.items():
        if name not in known:
            near = get_close_matches(name, known, n=1)
            hint = f'did you mean {near[0]}?' if near else f'known are {", ".join(known)}'
            raise ValueError(f'{path}: {name}: no such parameter; {hint}')
        if name in PARAMETERS:
            found[name] = checked(name, value, f'{path}: ')
    return found


def checked(name: str, value: Any, where: str = '') -> Any:
    """Return a value of a parameter, or raise ValueError if it cannot have it."""
    kind, _, (least, most), among, _ = PARAMETERS[name]
    if kind is list:
        if not isinstance(value, list):
            raise ValueError(f'{where}{name}: {value!r} is not a list')
        parts = value
    else:
        parts = [value]
    wanted: Any = {list: int, float: (int, float)}.get(kind, kind)
    for part in parts:
        if not isinstance(part, wanted) or (isinstance(part, bool) and kind is not bool):
            raise ValueError(f'{where}{name}: {part!r} is not of type {kind.__name__}')
        if most and not least <= part <= most:
            raise ValueError(f'{where}{name}: {part} is not within {least:g} to {most:g}')
        if among and part not in among:
            raise ValueError(f'{where}{name}: {part!r} is not one of {", ".join(among)}')
    return value


def known_markers(values: Mapping[str, Any]) -> dict[int, KnownMarker]:
    """Return the markers of the marker file; ValueError if it cannot be read."""
    if not values['marker_file']:
        return {}
    try:
        return load_markers(Path(values['marker_file']))
    except OSError as error:
        raise ValueError(f'marker_file: {error}') from error


def registered(values: Mapping[str, Any], known: Mapping[int, KnownMarker]) -> list[int]:
    """Return the IDs to report; empty = all."""
    ids = set(values['registered_ids'])
    if values['only_registered']:
        if not known:
            raise ValueError('only_registered: there is no marker_file with markers')
        ids |= set(known)
    return sorted(ids)


def noise_of(values: Mapping[str, Any]) -> NoiseLaw:
    """Return the noise of the sensor."""
    return NoiseLaw(values['noise_floor'], values['noise_slope'], values['noise_ambient'])


def sensor_of(values: Mapping[str, Any], grid: ZoneGrid) -> SensorModel:
    """Return the sensor, as calibrated."""
    pitch = values['zone_pitch']
    return replace(
        VL53L8CX,
        field_of_view=pitch * grid.columns if pitch else VL53L8CX.field_of_view,
        zone_blur=values['zone_blur'],
        range_offset_m=values['range_offset'],
        noise=noise_of(values),
    )


def detector_of(
    values: Mapping[str, Any], grid: ZoneGrid, known: Mapping[int, KnownMarker]
) -> Detector:
    """Return a new detector of values of all `PARAMETERS`; ValueError if they cannot be."""
    return create_detector(
        values['method'],
        grid,
        bit_period_s=values['bit_period'],
        likelihood_threshold=values['likelihood_threshold'],
        false_ids_per_hour=values['false_ids_per_hour'],
        max_packets=values['max_packets'],
        registered_ids=registered(values, known) or None,
        marker_sizes_m={marker.id: marker.size_m for marker in known.values()},
        sensor=sensor_of(values, grid),
    )
