# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Frames and packets of the wire, recordings of a marker or two, and what is read of them."""

import struct
from collections.abc import Iterable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from retrolidar_ros.detector import METHODS, Detection, Detector, create_detector
from retrolidar_ros.detector.decoding import Decoding
from retrolidar_ros.detector.parameters import defaults
from retrolidar_ros.scene import Scene, Simulation
from retrolidar_ros.scene.description import Marker, Sensor, Surface
from retrolidar_ros.scene.reference import NOISE, RESPONSE
from retrolidar_ros.sensor.frame import GRIDS, Floats, Frame, Recording, ZoneGrid
from retrolidar_ros.sensor.model import Status
from retrolidar_ros.sensor.wire import DELIMITER, FrameReader, WireCounts, encode_frame

START_NS = 1_700_000_000 * 10**9
FRAME_PERIOD_NS = 21_000_000


def make_frames(count: int, side: int = 4, seed: int = 1) -> list[Frame]:
    """Return consecutive frames of noise, some zones without a target."""
    rng = np.random.default_rng(seed)
    shape = (count, side * side)
    distance = rng.uniform(0, 4, shape).astype(np.float32)
    distance[rng.random(shape) < 0.2] = np.nan
    light = rng.uniform(0, 500, (2, *shape)).astype(np.float32)
    status = rng.integers(0, 256, shape, dtype=np.uint8)
    return [
        Frame(
            stamp_ns=START_NS + index * FRAME_PERIOD_NS,
            sequence=index,
            sensor_time_us=index * FRAME_PERIOD_NS // 1000,
            grid=ZoneGrid(side, side),
            distance=distance[index],
            signal=light[0, index],
            ambient=light[1, index],
            status=status[index],
        )
        for index in range(count)
    ]


def recording_of(middle_s: Floats, signal: Floats, distance: ArrayLike = 1.0) -> Recording:
    """Return frames of 4x4 zones, all valid; a distance is of shape (frames, 16) or one value."""

    def each(values: ArrayLike, dtype: type) -> NDArray[Any]:
        return np.broadcast_to(values, signal.shape).astype(dtype)

    stamp_ns = np.rint(1e9 * middle_s).astype(np.int64)
    return Recording(
        stamp_ns=stamp_ns,
        sequence=np.arange(len(stamp_ns)),
        sensor_time_us=stamp_ns // 1000,
        grid=ZoneGrid(),
        distance=each(distance, np.float32),
        signal=each(signal, np.float32),
        ambient=each(0.0, np.float32),
        status=each(Status.VALID, np.uint8),
    )


SENSOR_TIME_US = 0x0123456789AB
# The zones of one frame in the sensor's order: distance [mm/4], signal and ambient light
# [kcps/SPAD/2048], status. Zone 0 is the scene's top right.
ZONES = [(1000 * n - 4000, 2048 * n + 1024, 256 * n, 5 + n) for n in range(16)]
ZONES[6] = (0, 0, 2**24, 255)
ZONES[7] = (-32768, 2**24, 0, 0)


def content_of(
    rows: int, columns: int, zones: Iterable[tuple[int, ...]], kind: int = 1, sequence: int = 0
) -> bytes:
    """Return the content of a packet as the protocol's table has it."""
    header = struct.pack('<BIQBB', kind, sequence, SENSOR_TIME_US, rows, columns)
    return header + b''.join(struct.pack('<hIIB', *zone) for zone in zones)


def make_frame(side: int = 4, sequence: int = 7, **changes: Any) -> Frame:
    """Return a frame whose zones all differ."""
    zones = np.arange(side * side)
    frame = Frame(
        stamp_ns=0,
        sequence=sequence,
        sensor_time_us=21_000 * sequence,
        grid=ZoneGrid(side, side),
        distance=(0.5 + 0.01 * zones).astype(np.float32),
        signal=(10.0 + zones).astype(np.float32),
        ambient=(1.0 + zones / 4).astype(np.float32),
        status=np.full(side * side, 5, dtype=np.uint8),
    )
    return replace(frame, **changes)


def make_packets(count: int, side: int = 4) -> list[bytes]:
    """Return the packets of consecutive frames, each with its delimiter."""
    return [encode_frame(make_frame(side, sequence)) for sequence in range(count)]


def reader_in_step() -> FrameReader:
    """Return a reader that knows where the next packet begins."""
    reader = FrameReader()
    assert reader.feed(DELIMITER) == []
    return reader


def read(stream: bytes) -> tuple[list[Frame], WireCounts]:
    """Read a stream that comes in one piece, from a packet's beginning."""
    reader = reader_in_step()
    return reader.feed(stream), reader.counts


def sequences(frames: Iterable[Frame]) -> list[int]:
    return [frame.sequence for frame in frames]


# Repeated or alone, this ID shows no second preamble.
ID, OTHER_ID = 2073, 2096
ZONE = 9
GRID = ZoneGrid()

both_grids = pytest.mark.parametrize('grid', GRIDS.values(), ids=['4x4', '8x8'])
every_method = pytest.mark.parametrize('method', METHODS)


def a_scene(**marker: object) -> Scene:
    """Return a scene with one marker at 1.2 m in the middle of `ZONE`, and a wall behind it."""
    x, y, z = (1.2 * GRID.directions[ZONE]).tolist()
    settings: dict[str, Any] = {'name': 'marker', 'start_s': 2.0, 'packets': 1, **marker}
    own = {'id': ID, 'position_m': (x, y, z), 'response': RESPONSE, **settings}
    return Scene(
        sensor=Sensor(noise=NOISE),
        markers=(Marker(**own),),
        surfaces=(Surface(float(1.2 * GRID.z_per_range[ZONE]), 4.0),),
    )


def simulate(scene: Scene, duration_s: float = 4.5, seed: int = 3) -> Recording:
    return Simulation(scene, np.random.default_rng(seed)).run(duration_s)


@cache
def lone() -> Recording:
    """Return the frames of a lone packet."""
    return simulate(a_scene())


@cache
def repeating(duration_s: float) -> Recording:
    """Return the frames of a marker that never pauses."""
    return simulate(a_scene(start_s=0.0, packets=None), duration_s)


def run(frames: Iterable[Frame], detector: Detector | str = 'paper') -> list[Detection]:
    """Give a detector frames one by one; return what it reads."""
    if isinstance(detector, str):
        detector = create_detector(detector, GRID)
    return [detection for frame in frames for detection in detector.update(frame)]


def rms(values: ArrayLike) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def decoding(**changes: Any) -> Decoding:
    """Return what reads bags, some parameters changed."""
    return Decoding({**defaults(), **changes})


def ids(detections: Iterable[Detection]) -> list[int]:
    return [detection.id for detection in detections]
