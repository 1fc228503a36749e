# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What machine and what software figures were measured with."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

_PACKAGES = ('numpy', 'matplotlib', 'pyapriltags', 'pyzbar')
_PROCESSORS = Path('/proc/cpuinfo')


def machine() -> dict[str, Any]:
    """Return processor, number of cores, system, Python, and the versions of libraries."""
    return {
        'processor': _processor(),
        'cores': os.cpu_count() or 1,
        'machine': platform.machine(),
        'system': platform.system(),
        'python': platform.python_version(),
        'versions': {package: _version(package) for package in _PACKAGES},
    }


def write_figures(path: Path, figures: Mapping[str, Any], **run: Any) -> None:
    """Write figures as JSON, with what they were measured on and whatever else is said of it."""
    text = json.dumps({**figures, 'run': {**run, **machine()}}, indent=1)
    path.write_text(text + '\n', encoding='utf-8')


def _version(package: str) -> str | None:
    """Return a package's version; None where it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _processor() -> str:
    """Return the processor's name, as far as the system gives it."""
    if _PROCESSORS.exists():
        for line in _PROCESSORS.read_text(encoding='utf-8').splitlines():
            key, _, value = line.partition(':')
            if key.strip() == 'model name':
                return value.strip()
    return platform.processor() or platform.machine()
