# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checked parsing of nested mappings whose quantities carry their units: `period: 21 ms`."""

import math
import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, fields
from difflib import get_close_matches
from typing import Any, TypeAlias, TypeVar, cast, get_type_hints

T = TypeVar('T')
Parser: TypeAlias = Callable[[Any, str], T]
"""Parses a value that has a dotted name, for messages; ConfigError if it is invalid."""
Triple: TypeAlias = tuple[float, float, float]

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
_MAX_ITEMS = 256  # of a list: of markers, say
_QUANTITY = re.compile(r'\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*(\S.*?)?\s*')


class ConfigError(ValueError):
    """An impossible setting; the message names the key and what to write instead."""


class Section:
    """One mapping of a file: every key is taken once, and none may be left over."""

    def __init__(self, content: object, path: str = '') -> None:
        """Wrap `content`, found under the dotted `path`."""
        if not isinstance(content, Mapping):
            raise ConfigError(f'{path or "the file"}: needs keys with values, not {content!r:.100}')
        self._content = dict(content)
        self._path = path
        self._taken: list[str] = []

    def path(self, key: str) -> str:
        """Return the dotted name of a key, for messages."""
        return f'{self._path}.{key}' if self._path else key

    def take(self, key: str, parse: Parser[T], default: Any = MISSING) -> T:
        """Return the parsed value of a key; if it is missing, the default, or ConfigError."""
        if key not in self._content and default is MISSING:
            raise ConfigError(f'{self.path(key)}: is missing')
        self._taken.append(key)
        if key not in self._content:
            return cast(T, default)
        return parse(self._content.pop(key), self.path(key))

    def end(self) -> None:
        """Raise ConfigError for the first unknown key."""
        for key in self._content:
            near = get_close_matches(str(key), self._taken, n=1)
            hint = f'did you mean {near[0]}?' if near else 'known are ' + ', '.join(self._taken)
            raise ConfigError(f'{self.path(str(key))}: unknown key; {hint}')


def mapping(
    kind: type[T], check: Callable[[T, str], None] | None = None, **given: object
) -> Parser[T]:
    """Return a parser of mappings to a dataclass whose fields are annotated with their parsers.

    The key of `start_s: Annotated[float, quantity('time')]` is `start`, unless another one follows
    the parser; it is required if the field has no default. Fields that are `given` have no key.
    ConfigError, which names the key, for an unknown key and an impossible value; `check` raises it
    for values that do not go together.
    """

    def parse(value: Any, path: str) -> T:
        section = Section(value, path)
        values = dict(given)
        for field, key, parser in _keys(kind):
            if field.name not in given:
                values[field.name] = section.take(key, parser, field.default)
        section.end()
        found = kind(**values)
        if check is not None:
            check(found, path)
        return found

    return parse


def _keys(kind: Any) -> list[tuple[Field[Any], str, Parser[Any]]]:
    """Return the fields of a dataclass with their keys and parsers."""
    hints = get_type_hints(kind, include_extras=True)
    keys = []
    for field in fields(kind):
        parser, *key = getattr(hints[field.name], '__metadata__', (None,))
        keys.append((field, *(key or [re.sub('_(s|m|rad)$', '', field.name)]), parser))
    return keys


def quantity(
    kind: str, minimum: float = -_LARGEST, maximum: float = _LARGEST, *, bare: bool = False
) -> Parser[float]:
    """Return a parser of quantities such as `21 ms`, or `bare` ones, in the code's own unit."""

    def parse(value: Any, path: str) -> float:
        units = UNITS[kind]
        known = ' or '.join(units)
        match = _QUANTITY.fullmatch(str(value))
        if match is None:
            raise ConfigError(f'{path}: {value!r} is not a number with a unit ({known})')
        number, unit = match.groups()
        if unit is None and bare:
            unit = next(name for name, size in units.items() if size == 1)
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


def integer(minimum: int, maximum: int) -> Parser[int]:
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


def each(parse: Parser[T]) -> Parser[tuple[T, ...]]:
    """Return a parser of lists by that of their items."""

    def parse_all(value: Any, path: str) -> tuple[T, ...]:
        if not isinstance(value, list):
            raise ConfigError(f'{path}: needs a list, not {value!r}')
        if len(value) > _MAX_ITEMS:
            raise ConfigError(f'{path}: {len(value)} of them; {_MAX_ITEMS} are the most')
        return tuple(parse(item, f'{path}[{index}]') for index, item in enumerate(value))

    return parse_all


def place(max_m: float = _LARGEST) -> Parser[Triple]:
    """Return a parser of x, y and z within limits [m]."""
    lengths = each(quantity('length', -max_m, max_m))

    def parse(value: Any, path: str) -> Triple:
        found = lengths(value, path)
        if len(found) != 3:
            raise ConfigError(f'{path}: needs x, y and z, not {len(found)} values')
        x, y, z = found
        return x, y, z

    return parse
