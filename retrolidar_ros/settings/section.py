# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Checked parsing of nested mappings whose quantities carry their units: `period: 21 ms`."""

import math
import re
from collections.abc import Callable, Collection, Container, Mapping
from dataclasses import MISSING, fields
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


def suggestion(name: str, known: Collection[str]) -> str:
    """Return what an unknown name may have meant: the nearest of those known, or all of them."""
    near = get_close_matches(name, known, n=1)
    return f'did you mean {near[0]}?' if near else f'known are {", ".join(known)}'


def keyed(parsers: Mapping[str, Parser[Any]], optional: Container[str] = ()) -> Parser[Any]:
    """Return a parser of mappings by those of their keys; ConfigError for a missing or other key.

    The result lacks the optional keys that are not there.
    """

    def parse(value: Any, path: str) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise ConfigError(f'{path or "the file"}: needs keys with values, not {value!r:.100}')
        above = f'{path}.' if path else ''
        for key in value:
            if key not in parsers:
                raise ConfigError(f'{above}{key}: unknown key; {suggestion(str(key), parsers)}')
        for key in parsers:
            if key not in value and key not in optional:
                raise ConfigError(f'{above}{key}: is missing')
        return {key: one(value[key], above + key) for key, one in parsers.items() if key in value}

    return parse


def mapping(
    kind: type[T], check: Callable[[T, str], None] | None = None, **given: object
) -> Parser[T]:
    """Return a parser of mappings to a dataclass whose fields are annotated with their parsers.

    The key of `start_s: Annotated[float, quantity('time')]` is `start`, unless another one follows
    the parser; it is required if the field has no default. Fields that are `given` have no key.
    `check` raises ConfigError for values that do not go together.
    """

    def parse(value: Any, path: str) -> T:
        hints = get_type_hints(kind, include_extras=True)
        own = [field for field in fields(cast(Any, kind)) if field.name not in given]
        keys, parsers = {}, {}
        for field in own:
            parser, *key = hints[field.name].__metadata__
            keys[field.name] = name = (key or [re.sub('_(s|m|rad)$', '', field.name)])[0]
            parsers[name] = parser
        optional = [keys[field.name] for field in own if field.default is not MISSING]
        values = keyed(parsers, optional)(value, path)
        found = kind(**given, **{name: values[key] for name, key in keys.items() if key in values})
        if check is not None:
            check(found, path)
        return found

    return parse


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
