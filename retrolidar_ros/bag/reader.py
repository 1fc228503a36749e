# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Bags to frames."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from retrolidar_ros.bag.directory import read_messages
from retrolidar_ros.bag.errors import BagError, DamageError
from retrolidar_ros.bag.serialized import FRAME_TYPE, decode_frame
from retrolidar_ros.sensor.frame import Frame

FRAMES_TOPIC = '/retrolidar/frames'


def read_frames(path: str | Path, topic: str = FRAMES_TOPIC) -> Iterator[Frame]:
    """Read a bag's frames one after the other, in the order of the bag's timestamps.

    Parameters
    ----------
    path
        A bag's directory, or one of its files: `.mcap`, `.db3`, or either compressed, `.zstd`.
    topic
        Absolute name of the topic.

    Raises
    ------
    BagError
        If there is no such path or topic, if the topic's type is another, if it has no frames,
        or if a library is missing. If the bag is damaged or its recording did not end properly:
        after the frames before the damage.
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
