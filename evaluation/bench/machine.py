# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""What machine and what software figures were measured with."""

import json
import os
import platform
import re
from collections.abc import Mapping
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

_PACKAGES = ('numpy', 'matplotlib', 'pyapriltags', 'pyzbar')
_PROCESSORS = Path('/proc/cpuinfo')


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
