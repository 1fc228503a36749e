# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Files that ship with the package, and YAML files, with duplicate keys and aliases refused."""

from collections.abc import Callable, Hashable
from io import StringIO
from pathlib import Path
from typing import Any, TypeVar

import yaml

from retrolidar_ros.settings.section import ConfigError

T = TypeVar('T')

_PACKAGE = Path(__file__).absolute().parent.parent
MAX_BYTES = 2**20
_OF_TAGS = (LookupError, AttributeError, TypeError, ArithmeticError)  # as of `!!bool maybe`


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


class _CarefulLoader(yaml.SafeLoader):
    """Refuses a key that stands twice in one mapping, and, like ROS, aliases (YAML bombs)."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            loader: Any = self
            mark = loader.peek_event().start_mark
            raise yaml.composer.ComposerError(None, None, 'aliases are not read', mark)
        return super().compose_node(parent, index)

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:
        seen = set()
        for key_node, _ in node.value:
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
    """Return the content of a YAML file; OSError if it cannot be read.

    ValueError if it is a FIFO or not YAML, or has a duplicate key or an alias; it names the line.
    """
    if path.is_fifo():  # to open it would wait for a writer
        raise ValueError(f'{path} is a FIFO; give a regular file')
    try:
        with path.open('rb') as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise type(error)(f'{path} cannot be read: {error.strerror}') from error
    if len(data) > MAX_BYTES:
        raise ValueError(f'{path} is larger than the {MAX_BYTES} bytes that are read of YAML')
    try:
        return yaml.load(StringIO(data.decode()), Loader=_CarefulLoader)
    except (yaml.YAMLError, ValueError, RecursionError, *_OF_TAGS) as error:
        reason = str(error) if isinstance(error, (yaml.YAMLError, ValueError)) else repr(error)
        raise ValueError(f'{path} is not a YAML file: {reason}') from error


def yaml_text(content: object) -> str:
    """Return plain values as YAML, in their order, lists of numbers on lines of their own."""
    return yaml.safe_dump(content, sort_keys=False, default_flow_style=None)


def load_parsed(path: Path, parse: Callable[[Any], T]) -> T:
    """Return the parsed content of a YAML file; ConfigError, which names it, if it is wrong."""
    try:
        return parse(load_yaml(path))
    except ValueError as error:
        where = f'{path}: ' if isinstance(error, ConfigError) else ''  # else it names the path
        raise ConfigError(f'{where}{error}') from error
