# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""The parameters of all nodes, declared once: in `config/retrolidar.yaml`, with its comments.

`generate_parameter_library_py` is released for ROS only; the wheels and the command need them, too.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from retrolidar_ros.settings.files import load_yaml, shared_file

_OF_ROS = ('use_sim_time', 'qos_overrides', 'start_type_description_service')
_WILDCARDS = {'*': r'/\w+', '**': r'(/\w+)*'}
_ALIKE = 0.85  # names, by difflib
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


def file_sections(path: Path) -> dict[str, Mapping[Any, Any]]:
    """Return the sections of a parameter file by their names; OSError or ValueError if it is none.

    A name is that of a node with its namespaces, of which * stands for one, and ** for any number.
    """
    content = load_yaml(path)
    sections = content.values() if isinstance(content, Mapping) else ()
    if not any(isinstance(one, Mapping) and 'ros__parameters' in one for one in sections):
        raise ValueError(f'{path}: is no parameter file: it has no ros__parameters')
    found: dict[str, Mapping[Any, Any]] = {}
    for name, section in content.items():
        if not isinstance(section, Mapping) or 'ros__parameters' not in section:
            raise ValueError(f'{path}: {name} has no ros__parameters; add them, or take it out')
        values = section['ros__parameters'] or {}
        if not isinstance(values, Mapping):
            raise ValueError(f'{path}: {name}: ros__parameters are no names with values')
        found[str(name)] = values
    return found


def misspelled(sections: Iterable[str]) -> list[str]:
    """Return one sentence for each section whose name is nearly that of a node of the package."""
    found = []
    for section in sections:
        name = _last(section)
        near = get_close_matches(name, declared(), n=1, cutoff=_ALIKE)
        if near and name not in near:
            found.append(f'{section} is none of these nodes; did you mean {near[0]}?')
    return found


def file_values(path: Path, kind: str, node: str) -> dict[str, Any]:
    """Return what a parameter file says of a node of a kind, by its full name; errors as above.

    Left out are ROS's own parameters, and what is said of other nodes, too, but not known here.
    """
    sections = file_sections(path)
    return _values({name: sections[name] for name in sections if _is_of(name, node)}, kind)


def only_values(path: Path, kind: str) -> dict[str, Any]:
    """Return likewise what a file says of the only node of a kind; ValueError if there is none."""
    sections = file_sections(path)
    own = {name: sections[name] for name in sections if _last(name) in (kind, *_WILDCARDS)}
    if not any(_last(name) == kind for name in own) and (hints := misspelled(sections)):
        raise ValueError(f'{path}: {hints[0]}')
    if not own:
        raise ValueError(f'{path}: no section is for a {kind}; call it /**/{kind}')
    of_some = [name for name in own if name not in ('/**', f'/**/{kind}')]
    if len(of_some) > 1:
        raise ValueError(f'{path}: {", ".join(of_some)} are of several nodes; leave one of them')
    return _values(own, kind)


def _last(section: str) -> str:
    return section.rpartition('/')[2]


def _is_of(section: str, node: str) -> bool:
    """Return whether the name of a section is of a node, as ROS has it."""
    parts = section.removeprefix('/').split('/')
    pattern = ''.join(_WILDCARDS.get(one, f'/{re.escape(one)}') for one in parts)
    return bool(re.fullmatch(pattern, node))


def _values(sections: Mapping[str, Mapping[Any, Any]], kind: str) -> dict[str, Any]:
    """Return what sections say of a node of a kind; of two, the later one is right."""
    found: dict[str, Any] = {}
    for name, values in sections.items():
        for key, value in values.items():
            is_own = _last(name) == kind and str(key).partition('.')[0] not in _OF_ROS
            if is_own or key in declared()[kind]:
                found[str(key)] = value
    return found
