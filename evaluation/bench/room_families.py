# Copyright 2026 retrolidar_ros contributors
# SPDX-License-Identifier: Apache-2.0
"""Rooms of one kind each; everything else is that of the reference scene."""

import math

import numpy as np

from evaluation.bench.recordings import range_of, signal_at
from evaluation.bench.room_markers import Course, RoomMarker, room_marker
from evaluation.bench.room_scene import Room, RoomSimulation
from retrolidar_ros.detector import create_detector
from retrolidar_ros.marker.code import BIT_PERIOD_S, PACKET_BITS, PACKET_S, packet
from retrolidar_ros.marker.dictionary import USABLE_IDS
from retrolidar_ros.scene import Scene
from retrolidar_ros.scene.description import Surface
from retrolidar_ros.scene.reference import SENSOR, WALL_SIGNAL
from retrolidar_ros.sensor.frame import Floats

_CLOCK_ERROR, _QUARTZ_ERROR = 0.01, 1e-4
_BEHIND_M = 0.05  # how far behind the farthest marker the wall is
_APPEARS_S, _WATCHED_S = 3.0, 4.0
_TEN = 10


def _room(duration_s: float, *markers: RoomMarker) -> Room:
    depth_m = max(float(marker.course.place_m[2]) for marker in markers)
    wall = Surface(depth_m + _BEHIND_M, WALL_SIGNAL)
    scene = Scene(duration_s=duration_s, sensor=SENSOR, surfaces=(wall,))
    return Room(scene, BIT_PERIOD_S, markers)


def _bit_s(rng: np.random.Generator, error: float = _CLOCK_ERROR) -> float:
    return float(BIT_PERIOD_S * (1 + rng.uniform(-error, error)))


def _begun_s(rng: np.random.Generator) -> float:
    return float(-PACKET_S * rng.random())


def _anywhere(zone: int, range_m: float, rng: np.random.Generator) -> Floats:
    """Return a place in a zone [m], a tenth of it or more from its border."""
    tangents = SENSOR.grid.tangents[zone] + SENSOR.grid.pitch * rng.uniform(-0.4, 0.4, 2)
    ray: Floats = np.append(tangents, 1.0)
    return range_m * ray / np.linalg.norm(ray)


def crossing(speed_m_s: float, duration_s: float, rng: np.random.Generator) -> Room:
    """Return one marker that goes through the view at 1 m, and repeats."""
    half_m = SENSOR.grid.view / 2
    place_m = np.array([*rng.uniform(-0.85 * half_m, 0.85 * half_m, 2), 1.0])
    course = Course('crossing', place_m, speed_m_s=np.array([speed_m_s, 0.0]))
    marker = room_marker('repeating', course, _bit_s(rng), _begun_s(rng), duration_s, rng)
    return _room(duration_s, marker)


def other_period(period_s: float, duration_s: float, rng: np.random.Generator) -> Room:
    """Return one marker of another bit period that repeats its packet."""
    place_m = _anywhere(int(rng.integers(SENSOR.grid.zones)), rng.uniform(0.5, 2.0), rng)
    begin_s = -PACKET_BITS * period_s * rng.random()
    course = Course('still', place_m)
    return _room(duration_s, room_marker('period', course, period_s, begin_s, duration_s, rng))


def ten_packets(signal: float, rng: np.random.Generator) -> Room:
    """Return a marker in each zone that sends ten random packets, and is silent before and after.

    This is the paper's trial (§6.1).
    """
    lasting_s = (_TEN - 1.5) * PACKET_S  # `room_marker` sends one and a half more
    duration_s = (_TEN + 5) * PACKET_S
    markers = []
    for direction in SENSOR.grid.directions:
        course = Course('still', range_of(signal) * direction)
        begin_s = PACKET_S * (1.5 + rng.random())
        ends_s = (begin_s, begin_s + lasting_s)
        markers.append(room_marker('sequence', course, _bit_s(rng), *ends_s, rng))
    return _room(duration_s, *markers)


def pausing(number: int, pause_bits: float, rng: np.random.Generator) -> Room:
    """Return one marker that sends an ID again and again, with pauses of one length."""
    course = Course('still', _anywhere(int(rng.integers(SENSOR.grid.zones)), 1.0, rng))
    bit_s = _bit_s(rng)
    start_s = PACKET_S * rng.random() + bit_s * (PACKET_BITS + pause_bits) * np.arange(_TEN)
    levels = np.ones((_TEN, PACKET_BITS + 1))
    levels[:, :-1] -= packet(number)
    edges_s = start_s[:, None] + bit_s * np.arange(PACKET_BITS + 1)
    ids = np.full(_TEN, number)
    marker = RoomMarker('pauses', course, bit_s, ids, start_s, edges_s.ravel(), levels.ravel())
    return _room(float(start_s[-1]), marker)


def appearing(signal: float, rng: np.random.Generator) -> Room:
    """Return one marker that repeats, and appears in mid-packet."""
    zone = int(rng.integers(SENSOR.grid.zones))
    course = Course('still', _anywhere(zone, range_of(signal), rng))
    until_s, there = _APPEARS_S + _WATCHED_S, {'present_s': (_APPEARS_S, math.inf)}
    begin_s = _begun_s(rng)
    marker = room_marker('repeating', course, _bit_s(rng), begin_s, until_s, rng, **there)
    return _room(until_s, marker)


def pair(
    ratio: float, sendings: tuple[str, str], rng: np.random.Generator, *, woken: bool = False
) -> Room:
    """Return two markers in a zone, one of which has a share of the other's light.

    Markers that are woken begin to send at once, by quartz clocks.
    """
    zone, signal = int(rng.integers(SENSOR.grid.zones)), signal_at(1.3)
    duration_s = 12 * PACKET_S
    woken_s = PACKET_S * (1 + rng.random()) if woken else 0.0
    markers = []
    for sending, share in zip(sendings, (1.0, ratio), strict=True):
        course = Course('still', _anywhere(zone, range_of(share * signal), rng))
        bit_s = _bit_s(rng, _QUARTZ_ERROR) if woken else _bit_s(rng)
        begin_s = woken_s if woken else _begun_s(rng)
        markers.append(room_marker(sending, course, bit_s, begin_s, duration_s, rng))
    return _room(duration_s, *markers)


def first_id_s(room: Room, registered: int | None, rng: np.random.Generator) -> tuple[float, int]:
    """Return when the first right ID comes after the marker appears [s], and how many are wrong.

    The time is that of the frame with which it comes, infinite if none does.
    """
    recording = RoomSimulation(room, rng).run(room.scene.duration_s)
    own = int(room.markers[0].ids[0])
    ids = None
    if registered:
        others = rng.choice(USABLE_IDS[own != USABLE_IDS], registered - 1, replace=False)
        ids = np.append(others, own)
    detector = create_detector('joint', recording.grid, registered_ids=ids)
    found = [(frame.stamp_ns, one.id) for frame in recording for one in detector.update(frame)]
    times_s = [1e-9 * stamp_ns - _APPEARS_S for stamp_ns, id_ in found if id_ == own]
    return min(times_s, default=math.inf), len(found) - len(times_s)
