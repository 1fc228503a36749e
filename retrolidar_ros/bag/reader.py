# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags to frames."""

import re
from collections.abc import Iterator
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory

from retrolidar_ros.bag.files import read_mcap, read_sqlite
from retrolidar_ros.bag.messages import (
    FRAME_TYPE,
    BagError,
    DamageError,
    decode_frame,
    decompress,
    decompress_file,
)
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.settings.files import load_yaml

FRAMES_TOPIC = '/retrolidar/frames'


def read_frames(path: str | Path, topic: str = FRAMES_TOPIC) -> Iterator[Frame]:
    """Read a bag's frames one after the other, as they were recorded, from an absolute topic.

    The path is its directory, or one of its files: `.mcap`, `.db3`, or either compressed, `.zstd`.
    BagError if there is no such path or topic, its type is another, it has no frames, or a library
    is missing; if the bag is damaged or not complete: after the frames before the damage.
    """
    path = Path(path)
    types: dict[str, str] = {}
    frames = 0
    if not path.exists():
        raise BagError(f'{path} does not exist')
    try:
        for data in read_messages(path, topic, types):
            yield decode_frame(data)
            frames += 1
    except (DamageError, OSError) as error:
        raise BagError(f'{path}: {error} (after {frames} frames)') from error
    if topic not in types:
        found = ', '.join(f'{name} ({type_name})' for name, type_name in sorted(types.items()))
        raise BagError(f'{path}: no topic {topic}; there are: {found or "none"}')
    if types[topic] != FRAME_TYPE:
        raise BagError(f'{path}: {topic} is of type {types[topic]}, not {FRAME_TYPE}')
    if not frames:
        raise BagError(f'{path}: {topic} has no frames')


def salvage_frames(
    path: str | Path, topic: str = FRAMES_TOPIC
) -> tuple[list[Frame], BagError | None]:
    """Return a bag's good frames and its damage, if any; BagError if not even one is good."""
    frames: list[Frame] = []
    try:
        frames.extend(read_frames(path, topic))
    except BagError as error:
        if not frames:
            raise
        return frames, error
    return frames, None


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
        information = load_yaml(metadata)['rosbag2_bagfile_information']
        named = {bag / PurePath(name).name for name in information['relative_file_paths']}
    except (LookupError, TypeError, ValueError):
        return found, DamageError('metadata.yaml is damaged')
    if missing := ', '.join(sorted(file.name for file in named ^ set(found))):
        return found, DamageError(f'metadata.yaml and the directory differ in {missing}')
    return found, None


def _read_file(file: Path, topic: str, types: dict[str, str]) -> Iterator[bytes]:
    if file.suffix == '.zstd':
        with TemporaryDirectory() as directory:
            plain = Path(directory, file.stem)
            damage = decompress_file(file, plain)
            try:
                yield from _read_file(plain, topic, types)
            except DamageError:
                if damage is None:
                    raise
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
