# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What experiments report: figures, tables, and our values for items of the paper."""

import json
import os
import platform
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

from evaluation.bench.rates import LEVEL
from retrolidar_ros.detector import METHODS

NOTHING = '–'  # stands where there is no value: it was not measured, or the paper gives none
NOT_READ = f'< {100 * LEVEL:.0f} %'  # stands where fewer are read at the nearest place
UNSURE = 'unsure'  # stands where it is by chance to where so many are read

BOTH_CLAIMED = tuple(reversed(METHODS))  # the methods in the order of a claim's values
Table = list[list[str]]  # rows of text, the heads first
_PACKAGES = ('numpy', 'matplotlib', 'pyapriltags', 'pyzbar')
_PROCESSORS = Path('/proc/cpuinfo')


class Claim(NamedTuple):
    """Our values for one item of the paper, as text with units."""

    method: str = NOTHING  # what our implementation of the paper's method gives
    default: str = NOTHING  # what our default method gives, or a model that is the same for both


def model(text: str) -> Claim:
    """Return a claim of a model that is the same for both methods."""
    return Claim(default=text)


def shares(values: Iterable[float], digits: int = 0) -> Claim:
    """Return a claim of shares of the paper's method and of the default."""
    return Claim(*(f'{value:.{digits}%}' for value in values))


Claims = dict[str, Claim]  # by item; the report's chapter of the paper has the words


def as_text(value: float | None, unit: str = 'm', digits: int = 2) -> str:
    """Return a value with its unit as text."""
    if value is None:
        return NOTHING
    return f'{value:.{digits}f}{unit}' if unit == '°' else f'{value:.{digits}f} {unit}'.rstrip()


def end_as_text(end: Mapping[str, Any], axis: str, digits: int = 2, *, level: float = LEVEL) -> str:
    """Return to where a level is kept, with the axis's unit.

    It is 'unsure' where that is by chance, and '< 80 %' where less is read at the nearest place.
    """
    at, low, high = end['at'], end['low'], end['high']
    if high is None:
        return f'< {100 * level:.0f} %'
    if at is None or low is None or high - low > at / 2:
        return UNSURE
    return as_text(at, axis.partition('[')[2].rstrip(']'), digits)


def percent(rate: Any) -> str:
    """Return a rate as text, if it is known."""
    return NOTHING if rate is None else f'{rate["rate"]:.0%}'


def three_digits(value: float) -> str:
    """Return a number of three digits that count, without an exponent: 2530, 66.7."""
    return f'{value:.3g}' if abs(value) < 1000 else f'{float(f"{value:.3g}"):.0f}'


def per_hour(frequency: Any) -> str:
    """Return events an hour with their confidence as text."""
    value, low, high = (three_digits(frequency[name]) for name in ('per_hour', 'low', 'high'))
    return f'{value} ({low} to {high})'


def markdown(table: Sequence[Sequence[str]]) -> str:
    """Return a table as Markdown."""
    heads, *rows = table
    lines = [f'| {" | ".join(line)} |' for line in (heads, *rows)]
    return '\n'.join([lines[0], '|---' * len(heads) + '|', *lines[1:]])


def machine() -> dict[str, Any]:
    """Return processor, number of cores, system, Python, and the versions of libraries."""
    described = _PROCESSORS.read_text(encoding='utf-8') if _PROCESSORS.exists() else ''
    named = re.search(r'^model name\s*: (.+)$', described, re.MULTILINE)
    return {
        'processor': named[1].strip() if named else platform.processor() or platform.machine(),
        'cores': os.cpu_count() or 1,
        'machine': platform.machine(),
        'system': platform.system(),
        'python': platform.python_version(),
        'versions': {name: version(name) for name in _PACKAGES if find_spec(name)},
    }


def write_figures(path: Path, figures: Mapping[str, Any], **run: Any) -> None:
    """Write figures as JSON, with what they were measured on and whatever else is said of it."""
    text = json.dumps({**figures, 'run': {**run, **machine()}}, indent=1)
    path.write_text(text + '\n', encoding='utf-8')
