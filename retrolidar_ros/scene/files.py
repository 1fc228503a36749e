# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Scene files, by path or by name."""

from pathlib import Path

from retrolidar_ros.scene.description import Scene, parse_scene
from retrolidar_ros.settings.resources import shared_file
from retrolidar_ros.settings.yaml_files import load_parsed


def scene_names() -> list[str]:
    """Return the names of the scenes that ship with the package."""
    return sorted(path.stem for path in shared_file('config/scenes').glob('*.yaml'))


def find_scene(name: str) -> Path:
    """Return the file of a scene by path or name; FileNotFoundError, with all names, if none is."""
    if Path(name).is_file():
        return Path(name)
    shipped = shared_file('config/scenes') / f'{name}.yaml'
    if shipped.is_file():
        return shipped
    known = ', '.join(scene_names())
    raise FileNotFoundError(f'there is no scene {name}; give a file, or one of {known}')


def load_scene(name: str) -> Scene:
    """Return a scene by path or name; errors as of `find_scene` and `load_parsed`."""
    return load_parsed(find_scene(name), parse_scene)
