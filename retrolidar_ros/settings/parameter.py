# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of all nodes, declared once: in `config/retrolidar.yaml`, with its comments.

`generate_parameter_library_py` is released for ROS only; the wheels and the command need them, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_yaml

_OF_ROS = ('use_sim_time', 'qos_overrides', 'start_type_description_service')
_COMMENTED = re.compile(r'((?:^    # .*\n)+)    (\w+):', re.M)
_COMMENT = re.compile(r'(.+?)(?: Range: (\S+) to (\S+)\.)?(?: One of: (.+?)\.)?( Live\.)?')


class Parameter(NamedTuple):
    """A parameter of a node; some of the detector's are options of the command, too."""

    default: Any  # its type is that of the parameter: bool, int, float, str, or list
    description: str  # with the unit
    limits: tuple[float, float] | None  # of numbers; a list without limits holds str
    among: tuple[str, ...]  # what a str may be; empty = anything
    is_live: bool  # whether it may be set while the node runs

    @classmethod
    def of(cls, default: Any, comment: str) -> Parameter:
        """Return the parameter that a comment describes."""
        found = _COMMENT.fullmatch(comment)
        assert found, comment
        description, low, high, among, live = found.groups()
        limits = (float(low), float(high)) if low else None
        allowed = tuple(among.split(', ')) if among else ()
        return cls(default, description, limits, allowed, bool(live))

    def summary(self) -> str:
        """Return the first sentence of the description."""
        return f'{self.description.partition(". ")[0].rstrip(".")}.'

    def constraints(self) -> str:
        """Return which values are allowed; empty if any of the type are."""
        low, high = self.limits or (0, 0)
        if isinstance(self.default, list):
            return f'integers from {low} to {high}, or []' if self.limits else 'texts, or []'
        if self.limits:
            return f'{low:.9g} to {high:.9g}'
        return f'one of {", ".join(self.among)}' if self.among else ''

    def check(self, name: str, value: Any) -> Any:
        """Return a value in the parameter's type; ValueError, which names it, if not allowed."""
        if isinstance(self.default, list):
            return self._check_list(name, value)
        kind = type(self.default)
        wanted = (int, float) if kind is float else kind
        if not isinstance(value, wanted) or (isinstance(value, bool) and kind is not bool):
            raise ValueError(f'{name}: {value!r} is not of type {kind.__name__}')
        if self.among and value not in self.among:
            raise ValueError(f'{name}: {value!r} is not {self.constraints()}')
        self._check_limits(name, value)
        return kind(value)

    def _check_list(self, name: str, value: Any) -> list[Any]:
        if isinstance(value, str) or not isinstance(value, Iterable):
            raise ValueError(f'{name}: {value!r} is not a list')
        values = list(value)
        if self.limits and len(values) > (most := int(self.limits[1] - self.limits[0]) + 1):
            raise ValueError(f'{name}: {len(values)} numbers; {most} are the most')
        for one in values:
            if self.limits and (isinstance(one, bool) or not isinstance(one, int)):
                raise ValueError(f'{name}: {one!r} is not a whole number')
            if not self.limits and not (isinstance(one, str) and one):
                raise ValueError(f'{name}: {one!r} is not a text')
            self._check_limits(name, one)
        return values

    def _check_limits(self, name: str, value: Any) -> None:
        if self.limits:
            low, high = self.limits
            if not low <= value <= high:
                raise ValueError(f'{name}: {value} is not within {low:.9g} to {high:.9g}')


@cache
def declared() -> dict[str, dict[str, Parameter]]:
    """Return the parameters of every node by its name and theirs, in the order of the file."""
    path = shared_file('config/retrolidar.yaml')
    _, *parts = re.split(r'^/\*\*/(\w+):$', path.read_text(encoding='utf-8'), flags=re.M)
    defaults = load_yaml(path)
    nodes = {}
    for node, text in zip(parts[::2], parts[1::2], strict=True):
        commented = _COMMENTED.findall(text)
        comments = {name: ' '.join(re.findall('# (.+)', lines)) for lines, name in commented}
        nodes[node] = {
            name: Parameter.of(default, comments[name])
            for name, default in defaults[f'/**/{node}']['ros__parameters'].items()
        }
    return nodes


def file_values(path: Path, kind: str) -> dict[str, Any]:
    """Return what a parameter file says of nodes of a kind; OSError or ValueError if it is none.

    Left out are ROS's own parameters, and what is said of all nodes (`/**`) but not known here.
    """
    content = load_yaml(path)
    sections = content.values() if isinstance(content, Mapping) else ()
    if not any(isinstance(one, Mapping) and 'ros__parameters' in one for one in sections):
        raise ValueError(f'{path}: is no parameter file: it has no ros__parameters')
    found: dict[str, Any] = {}
    for node, section in content.items():
        name = str(node).rpartition('/')[2]
        if not isinstance(section, Mapping) or 'ros__parameters' not in section:
            raise ValueError(f'{path}: {node} has no ros__parameters; add them, or take it out')
        if name not in (kind, '**'):
            continue
        values = section['ros__parameters'] or {}
        if not isinstance(values, Mapping):
            raise ValueError(f'{path}: {node}: ros__parameters are no names with values')
        for key, value in values.items():
            is_own = name == kind and str(key).partition('.')[0] not in _OF_ROS
            if is_own or key in declared()[kind]:
                found[str(key)] = value
    return found
