# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Messages from all files of a bag."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory

from retrolidar_ros.bag.compression import decompress, decompress_file
from retrolidar_ros.bag.errors import DamageError
from retrolidar_ros.bag.mcap_file import read_mcap
from retrolidar_ros.bag.sqlite_file import read_sqlite
from retrolidar_ros.settings.yaml_files import load_yaml

_METADATA_KEYS = {
    'version',
    'storage_identifier',
    'relative_file_paths',
    'starting_time',
    'duration',
    'message_count',
    'topics_with_message_count',
}
_ZSTD_MAGIC = b'\x28\xb5\x2f\xfd'


def read_messages(path: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from all files of a bag; note the types of all topics."""
    if not path.is_dir():
        yield from _read_file(path, topic, types)
        return
    files, damage = _bag_files(path)
    try:
        for file in files:
            yield from _read_file(file, topic, types)
    except DamageError as error:
        raise DamageError(f'{file.name}: {error}') from error
    if damage is not None:
        raise damage


def _bag_files(bag: Path) -> tuple[list[Path], DamageError | None]:
    """Return the files of a bag, oldest first, and the damage of its metadata, if any."""
    found = [file for file in bag.iterdir() if re.search(r'\.(mcap|db3)(\.zstd)?$', file.name)]
    # Recorders number their files: bag_9 comes before bag_10.
    found.sort(key=lambda file: ([int(digits) for digits in re.findall(r'\d+', file.name)], file))
    if not found:
        return found, DamageError('no .mcap or .db3 file in this directory')
    metadata = bag / 'metadata.yaml'
    if not metadata.exists():
        return found, DamageError('no metadata.yaml: the recording did not end properly')
    if not metadata.is_file():
        return found, DamageError('metadata.yaml is no file')
    try:
        content = load_yaml(metadata)
        information = content['rosbag2_bagfile_information']
        named = [bag / PurePath(name).name for name in information['relative_file_paths']]
        damaged = not information.keys() >= _METADATA_KEYS or len(set(named)) < len(named)
    except (AttributeError, LookupError, TypeError, ValueError):
        damaged = True
    if damaged:
        return found, DamageError('metadata.yaml is damaged')
    if set(named) != set(found):
        names = sorted(file.name for file in set(named) ^ set(found))
        return found, DamageError(f'metadata.yaml and the directory differ in {", ".join(names)}')
    return named, None


def _read_file(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    """Yield the messages of a topic from one file of a bag, oldest first."""
    if file.suffix == '.zstd':
        with TemporaryDirectory() as directory:
            plain = Path(directory, file.stem)
            damage = decompress_file(file, plain)
            if damage is None or plain.stat().st_size:
                yield from _read_file(plain, topic, types)
        if damage is not None:
            raise damage
        return
    readers = {'.mcap': read_mcap, '.db3': read_sqlite}
    if file.suffix not in readers:
        raise DamageError('the name does not end in .mcap or .db3')
    if not file.stat().st_size:
        raise DamageError('the file is empty')
    for data in readers[file.suffix](file, topic, types):
        yield decompress('zstd', data) if data.startswith(_ZSTD_MAGIC) else data
