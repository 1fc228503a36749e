# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames to bags."""

from __future__ import annotations

import sqlite3
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from retrolidar_ros.bag.messages import ARRAYS, FRAME_TYPE, INSTALL, BagError
from retrolidar_ros.bag.reader import FRAMES_TOPIC
from retrolidar_ros.sensor.frame import Frame
from retrolidar_ros.settings.files import shared_file

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

STORAGES = ('mcap', 'sqlite3')
_COMMITTED = 250  # frames at a time: what a disk that fills up, or a power cut, may cost


@cache
def _type_store() -> Typestore:
    from rosbags import typesys

    definition = shared_file('msg/Frame.msg').read_text(encoding='utf-8')
    types = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    types.register(typesys.get_types_from_msg(definition, FRAME_TYPE))
    return types


class FrameWriter:
    """Writes frames to a new bag; a context manager, which keeps them if its block fails."""

    def __init__(
        self,
        path: str | Path,
        storage: str = STORAGES[0],
        topic: str = FRAMES_TOPIC,
        frame_id: str = 'retrolidar_optical_frame',
    ) -> None:
        """Prepare a bag, made on entering the block; BagError if that is not possible."""
        try:
            from rosbags import rosbag2
        except ImportError as error:
            raise BagError(f'writing a bag needs the rosbags library: {INSTALL}') from error
        self._errors = (OSError, sqlite3.Error, struct.error, rosbag2.WriterError)
        if storage not in STORAGES:
            raise BagError(f'storage {storage!r} is not {" or ".join(STORAGES)}')
        with self._bag_errors():
            # Version 8 is the last that ROS 2 Humble can read. Without a QoS profile, `ros2 bag
            # play` offers a reliable topic of depth 10.
            self._writer = rosbag2.Writer(
                path, version=8, storage_plugin=rosbag2.StoragePlugin[storage.upper()]
            )
            self._types = _type_store()
        self._storage = storage
        self._topic = topic
        self._frame_id = frame_id

    @contextmanager
    def _bag_errors(self) -> Iterator[None]:
        """Turn the errors of the libraries into `BagError`."""
        try:
            yield
        except self._errors as error:
            raise BagError(str(error)) from error

    def __enter__(self) -> FrameWriter:
        """Make the bag; BagError if that fails."""
        self._written = 0
        with self._bag_errors():
            self._writer.open()
            self._connection = self._writer.add_connection(
                self._topic, FRAME_TYPE, typestore=self._types
            )
        return self

    def write(self, frame: Frame, received_ns: int | None = None) -> None:
        """Append a frame; the bag's own timestamp is that of its receipt, or else its stamp.

        ValueError if an array has not one value a zone; BagError if a number does not fit the
        message, or the file cannot be written.
        """
        frame.check()
        arrays: dict[str, NDArray[Any]] = {
            name: np.ascontiguousarray(getattr(frame, name), dtype) for name, dtype in ARRAYS
        }
        received_ns = frame.stamp_ns if received_ns is None else received_ns
        for time_ns in (frame.stamp_ns, received_ns):
            if not 0 <= time_ns < 2**63:
                raise BagError(f'frame {frame.sequence}: {time_ns} ns is no ROS time')
        types = self._types.types
        stamp = types['builtin_interfaces/msg/Time'](*divmod(frame.stamp_ns, 10**9))
        message = types[FRAME_TYPE](
            header=types['std_msgs/msg/Header'](stamp, self._frame_id),
            sequence=frame.sequence,
            sensor_time=frame.sensor_time_us,
            rows=frame.grid.rows,
            columns=frame.grid.columns,
            **arrays,
        )
        with self._bag_errors():
            data = self._types.serialize_cdr(message, FRAME_TYPE)
            self._writer.write(self._connection, received_ns, data)
            self._written += 1
            if self._written % _COMMITTED == 0:
                self._commit()

    def _commit(self) -> None:
        """Put on the disk what was written, instead of a megabyte at a time or all at the end."""
        storage: Any = self._writer.storage
        if self._storage == 'mcap':
            storage.close_chunk()
            storage.bio.flush()
        else:
            storage.conn.commit()

    def __exit__(self, *_: object) -> None:
        """Close the bag; BagError if that fails."""
        with self._bag_errors():
            self._writer.close()
