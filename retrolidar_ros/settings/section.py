# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checked parsing of nested mappings whose quantities carry their units: `period: 21 ms`."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping
from difflib import get_close_matches
from typing import Any, TypeVar

T = TypeVar('T')

UNITS: dict[str, dict[str, float]] = {
    'time': {'s': 1.0, 'ms': 1e-3, 'us': 1e-6},
    'length': {'m': 1.0, 'cm': 1e-2, 'mm': 1e-3},
    'angle': {'deg': math.pi / 180, 'rad': 1.0},
    'share': {'%': 1e-2},
    'signal': {'kcps/SPAD': 1.0},
    'variance': {'(kcps/SPAD)^2': 1.0},
    'charge': {'mAh': 1.0},
}
"""Units of each kind of quantity, and their size in the unit that the code uses."""

_LARGEST = 1e9  # of any quantity, in the code's own unit: what is computed from it stays finite
_MOST_ITEMS = 256  # of a list: of markers, say
_QUANTITY = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*')


class ConfigError(ValueError):
    """An impossible setting; the message names the key and what to write instead."""


class Section:
    """One mapping of a file: every key is taken once, and none may be left over."""

    def __init__(self, content: object, path: str = '') -> None:
        """Wrap `content`, found under the dotted `path`."""
        if not isinstance(content, Mapping):
            raise ConfigError(f'{path or "the file"}: needs keys with values, not {content!r}')
        self._content = dict(content)
        self._path = path
        self._taken: list[str] = []

    def path(self, key: str) -> str:
        """Return the dotted name of a key, for messages."""
        return f'{self._path}.{key}' if self._path else key

    def take(self, key: str, default: T, parse: Callable[[Any, str], T]) -> T:
        """Return the parsed value of a key, or the default if it is missing."""
        self._taken.append(key)
        if key not in self._content:
            return default
        return parse(self._content.pop(key), self.path(key))

    def need(self, key: str, parse: Callable[[Any, str], T]) -> T:
        """Return the parsed value of a required key."""
        if key not in self._content:
            raise ConfigError(f'{self.path(key)}: is missing')
        self._taken.append(key)
        return parse(self._content.pop(key), self.path(key))

    def end(self) -> None:
        """Raise ConfigError for the first unknown key."""
        for key in self._content:
            near = get_close_matches(str(key), self._taken, n=1)
            hint = f'did you mean {near[0]}?' if near else 'known are ' + ', '.join(self._taken)
            raise ConfigError(f'{self.path(str(key))}: unknown key; {hint}')


def quantity(
    kind: str, minimum: float = -_LARGEST, maximum: float = _LARGEST
) -> Callable[[Any, str], float]:
    """Return a parser of quantities such as `21 ms` within limits in the code's own unit."""

    def parse(value: Any, path: str) -> float:
        units = UNITS[kind]
        known = ' or '.join(units)
        match = _QUANTITY.fullmatch(str(value))
        if match is None:
            raise ConfigError(f'{path}: {value!r} is not a number with a unit ({known})')
        number, unit = match.groups()
        if unit is None:
            raise ConfigError(f'{path}: {value!r} has no unit; write {number} {next(iter(units))}')
        if unit not in units:
            raise ConfigError(f'{path}: {value!r} is in {unit}; it needs {known}')
        size = float(number) * units[unit]
        if not minimum <= size <= maximum:
            limit, word = (minimum, 'least') if size < minimum else (maximum, 'most')
            raise ConfigError(f'{path}: {value!r} is impossible; at {word} {limit / units[unit]:g}')
        return size

    return parse


def integer(minimum: int, maximum: int) -> Callable[[Any, str], int]:
    """Return a parser of whole numbers within limits."""

    def parse(value: Any, path: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int):
            raise ConfigError(f'{path}: {value!r} is not a whole number')
        if not minimum <= value <= maximum:
            raise ConfigError(f'{path}: {value} is impossible; {minimum} to {maximum}')
        return value

    return parse


def text(value: Any, path: str) -> str:
    """Parse a non-empty string."""
    if not isinstance(value, str) or not value:
        raise ConfigError(f'{path}: {value!r} is not a text')
    return value


def items(value: Any, path: str) -> list[tuple[Any, str]]:
    """Parse a list into its items, each with its own path."""
    if not isinstance(value, list):
        raise ConfigError(f'{path}: needs a list, not {value!r}')
    if len(value) > _MOST_ITEMS:
        raise ConfigError(f'{path}: {len(value)} of them; {_MOST_ITEMS} are the most')
    return [(item, f'{path}[{index}]') for index, item in enumerate(value)]
