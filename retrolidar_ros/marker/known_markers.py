# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Marker files: names and places of the markers that a robot knows."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from retrolidar_ros.marker.code import IDS
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.sensor.frame import Floats
from retrolidar_ros.settings.files import load_parsed
from retrolidar_ros.settings.section import ConfigError, Triple, keyed, mapping, place, text

_FRAME = re.compile(r'[A-Za-z0-9_.-][A-Za-z0-9_./-]*')  # TF accepts no leading slash
_MAX_CHARACTERS = 100  # of a frame: topics bear it, and DDS allows 255 of the whole name
_USUAL_FRAME = re.compile(r'marker_([0-9]+)')


def _frame(value: Any, path: str) -> str:
    name = text(value, path)
    if not _FRAME.fullmatch(name):
        raise ConfigError(
            f'{path}: {name!r} cannot be a TF frame; letters, digits and _ . - / within'
        )
    if len(name) > _MAX_CHARACTERS:
        raise ConfigError(
            f'{path}: a name of {len(name)} characters is too long; {_MAX_CHARACTERS} are the most'
        )
    return name


@dataclass(frozen=True)
class KnownMarker:
    """One line of a marker file."""

    id: int
    frame: Annotated[str, _frame] = ''  # its TF frame; if none is given, named by its ID
    note: Annotated[str, text] = ''
    object: Annotated[str, _frame] = ''  # what it is fixed to; empty: it is an object of its own
    place_m: Annotated[Triple, place(100)] = (0.0, 0.0, 0.0)  # where on that

    def __post_init__(self) -> None:
        """Name the frame."""
        object.__setattr__(self, 'frame', self.frame or frame_of(self.id, {}))


def usual_id(frame: str) -> int | None:
    """Return the ID of the marker that has a frame unless its file names it; None of another."""
    found = _USUAL_FRAME.fullmatch(frame)
    return int(found[1]) if found else None


def frame_of(marker_id: int, known: Mapping[int, KnownMarker]) -> str:
    """Return the TF frame of a marker, known or not."""
    return known[marker_id].frame if marker_id in known else f'marker_{marker_id}'


def parse_markers(content: object) -> dict[int, KnownMarker]:
    """Return the markers of a YAML file's content; ConfigError for an impossible one."""
    known: dict[int, KnownMarker] = keyed({'markers': _markers})(content, '')['markers']
    return known


def _markers(value: Any, path: str) -> dict[int, KnownMarker]:
    if not isinstance(value, Mapping):
        raise ConfigError(f'{path}: needs a mapping of IDs to markers, not {value!r}')
    known: dict[int, KnownMarker] = {}
    for identity, one in value.items():
        is_number = isinstance(identity, int) and not isinstance(identity, bool)
        if not is_number or identity not in USABLE_IDS:
            raise ConfigError(f'{path}: {identity!r} is not an ID; numbers of 1 to {IDS - 2} are')
        known[identity] = mapping(KnownMarker, id=identity)(one, f'{path}.{identity}')
    owners: dict[str, int] = {}
    for marker in known.values():
        usual = usual_id(marker.frame)
        if usual not in (None, marker.id):
            raise ConfigError(
                f'{path}.{marker.id}.frame: {marker.frame} is what marker {usual} is called'
            )
        other = owners.setdefault(marker.frame, marker.id)
        if other != marker.id:
            raise ConfigError(
                f'{path}.{marker.id}.frame: marker {other} has the frame {marker.frame}, too'
            )
    return known


def objects_of(known: Mapping[int, KnownMarker]) -> dict[str, dict[int, Floats]]:
    """Return the markers of each object that has some, with their places on it, shape (3,) [m]."""
    objects: dict[str, dict[int, Floats]] = {}
    for marker in known.values():
        if marker.object:
            objects.setdefault(marker.object, {})[marker.id] = np.array(marker.place_m)
    return objects


def load_markers(path: Path) -> dict[int, KnownMarker]:
    """Return the markers that a marker file names, by their IDs; errors as of `load_parsed`."""
    return load_parsed(path, parse_markers)
