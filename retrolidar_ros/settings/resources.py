# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Paths of the files that ship with the package, from the source tree or where it is installed."""

from pathlib import Path

_PACKAGE = Path(__file__).absolute().parent.parent


def shared_file(name: str) -> Path:
    """Return the path of a file of the package, or FileNotFoundError with the places searched."""
    beside = _PACKAGE.parent
    directories = [parent / 'share' / _PACKAGE.name for parent in beside.parents]
    if (beside / 'package.xml').is_file():
        directories.insert(0, beside)
    for directory in directories:
        if (directory / name).exists():
            return directory / name
    places = ', '.join(map(str, directories))
    raise FileNotFoundError(f'{name} of {_PACKAGE.name} is missing; looked for it in {places}')
