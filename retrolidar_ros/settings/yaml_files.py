# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""YAML files, with duplicate keys refused."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from pathlib import Path
from typing import Any, TypeVar

import yaml

from retrolidar_ros.settings.section import ConfigError

T = TypeVar('T')


class _UniqueKeyLoader(yaml.SafeLoader):
    """Refuses a duplicate key in a mapping; plain YAML takes the last one."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
            if key_node.tag == 'tag:yaml.org,2002:merge':
                continue  # what is merged in may be overridden
            key = self.construct_object(key_node, deep=True)
            if not isinstance(key, Hashable):
                continue  # refused by the base class
            if key in seen:
                raise yaml.constructor.ConstructorError(
                    None, None, f'key {key!r} stands here a second time', key_node.start_mark
                )
            seen.add(key)
        return super().construct_mapping(node, deep=deep)


def load_yaml(path: Path) -> Any:
    """Return the content of a YAML file.

    Raises
    ------
    OSError
        If it cannot be read.
    ValueError
        If it is not YAML, or a key is duplicate; the message names the line.
    """
    with path.open(encoding='utf-8') as file:
        try:
            return yaml.load(file, Loader=_UniqueKeyLoader)
        except (yaml.YAMLError, ValueError, RecursionError) as error:
            raise ValueError(f'{path} is not a YAML file: {error}') from error


def load_parsed(path: Path, parse: Callable[[Any], T]) -> T:
    """Return the parsed content of a YAML file.

    Raises
    ------
    OSError
        If it cannot be read.
    ConfigError
        If the content is impossible; the message names the file and the key.
    """
    try:
        content = load_yaml(path)
    except ValueError as error:
        raise ConfigError(str(error)) from error
    try:
        return parse(content)
    except ConfigError as error:
        raise ConfigError(f'{path}: {error}') from error


def load_parameter_defaults(path: Path, kind: str) -> dict[str, Any]:
    """Return the parameters in a ROS parameter file for the nodes of one kind."""
    parameters: dict[str, Any] = load_yaml(path)[f'/**/{kind}']['ros__parameters']
    return parameters
